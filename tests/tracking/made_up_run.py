"""A made-up run folder: every file that the report reads, small, with known structure."""

import json
from collections.abc import Sequence
from contextlib import ExitStack
from itertools import product
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd

from lidarplace.logs.boxes import CLASSES
from tests.tracking.made_up_objects import made_up_found, made_up_frames, made_up_objects
from tracking.findings.training_cost import COST_AXES
from tracking.report.analysis import Analysis
from tracking.report.build import SECTIONS, build_report

IOUS = {"Car": (0.5, 0.7), "Cyclist": (0.5,), "Pedestrian": (0.5,), "all": (0.5,)}
NAMES = ("line", "center", "trapezoid", "line_roll", "pyramid <b>&amp;")
ROI = {"x": [0.0, 20.0], "y": [-10.0, 10.0], "z": [0.0, 4.0], "resolution": 0.5}


def report_of(folder: Path, *sections: str) -> Path:
    """The report with these sections alone, in a tenth of the time of a whole one; with "failures"
    also the pages of the decision and of the failures."""
    with ExitStack() as stack:
        makers = {name: SECTIONS.own[name] for name in sections}
        stack.enter_context(patch.object(SECTIONS, "own", makers))
        if "failures" not in makers:
            stack.enter_context(patch.object(Analysis, "pair", None))
            stack.enter_context(patch("tracking.report.build.write_decision", return_value=None))
        return build_report(folder)


def write_run(
    path: Path,
    names: Sequence[str] = NAMES,
    seeds: Sequence[int] = (1, 2),
    detectors: Sequence[str] = ("pointpillars_tiny",),
    densities: Sequence[int] = (),
    trainings: Sequence[tuple[int, float]] = (),
    evaluators: Sequence[str] = (),
    clouds: Sequence[str] = (),
    roi: dict[str, object] = ROI,
    points: int = 300,
    seed: int = 0,
    enough: bool = False,
) -> Path:
    """Write a run folder with `names` as placements.

    `densities` adds an axis "scene.density", `trainings` those of epochs and share of the frames,
    `evaluators` of the placements: a generalist 20 points above specialists, half as far apart.
    `clouds` those of an axis over recorded and simulated ones.
    With `enough` there are enough individuals and epochs for a headline.
    Without `detectors` it is a sweep of surrogates alone: no results, no frame, maps of some.
    """
    rng = np.random.default_rng(seed)
    path.mkdir(parents=True)
    scenes = [{"scene.density": density} for density in densities] or [{}]
    scenes = [scene | {"scene.clouds": kind} for scene in scenes for kind in clouds] or scenes
    lengths = [dict(zip(COST_AXES, training, strict=True)) for training in trainings] or [{}]
    judges = [{"evaluator": name} for name in evaluators] or [{}]
    settings = [scene | length | one for scene in scenes for length in lengths for one in judges]
    quality = dict(zip(names, rng.permutation(len(names)) / len(names), strict=True))

    trials, results, curves = [], [], []
    ended = {"status": "finished", "error": ""}
    for detector, setting, name, number in product(detectors, settings, names, seeds):
        common = {"trial": f"t{len(trials):03d}", "placement": name, "detector": detector}
        common |= {"seed": number, **setting}
        seconds = (60 + 20 * rng.random()) / (20 if setting.get("evaluator") == "generalist" else 1)
        trials.append({**common, "seconds": seconds, **ended})
        results += _results(rng, common, setting, quality[name])
        curves += _curve(rng, str(common["trial"]), setting, enough)
    if not detectors:
        trials = [
            {"trial": f"t{i:03d}", "placement": name, "detector": None, "seed": 0, **scene}
            | {"seconds": np.nan, **ended}
            for i, (scene, name) in enumerate(product(scenes, names))
        ]
    of_objects = np.random.default_rng(seed + 1)
    objects = made_up_objects(of_objects, scenes) if detectors else []
    estimates, resamples = _sampling_error(rng, quality, scenes)
    tables = {"trials": trials, "results": results, "curves": curves, "objects": objects}
    tables |= {"sampling_error": estimates, "pog_resamples": resamples, "tasks": _tasks(trials)}
    tables |= {"distance": _distance(results), "sector": _sector(results)}
    tables["left_out"] = _left_out(rng, results)
    tables["points"] = _points(rng, quality, scenes) if detectors else []
    tables["individuals"] = _individuals(scenes, 102 if enough else 34) if detectors else []
    tables["found"] = made_up_found(of_objects, objects, trials, quality)
    tables["surrogates"] = _surrogates(rng, quality, scenes)
    tables["accuracy"] = _accuracy(rng, names)
    for name, rows in tables.items():
        pd.DataFrame(rows).to_parquet(path / f"{name}.parquet", index=False)

    poses = [[0.0, y, 2.2, 0.0, 0.0, 0.0] for y in (-0.6, -0.4, 0.4, 0.6)]
    sweep = {
        "name": path.name,
        "command": f"lidarplace run examples/{path.name}.yaml",
        "axes": ["placement", "training.seed", *settings[0]],
        "placements": dict.fromkeys(names, poses),
        "classes": list(CLASSES),
        "roi": roi,
        "versions": {"lidarplace": "0.1.0", "numpy": np.__version__},
    }
    sweep |= {"frames": {"train": 400, "test": 100}, "seconds": 1234.5, "cores": 2}
    (path / "sweep.json").write_text(json.dumps(sweep), encoding="utf-8")
    (path / "config.yaml").write_text("scene:\n  density: 40\n", encoding="utf-8")
    _write_maps(path, names if detectors else names[:12], roi)
    if detectors:
        _write_frame(rng, path, names, points)
        arrays = made_up_frames(of_objects, objects, (names[0], names[-1]), [0, 13])
        np.savez_compressed(path / "failures.npz", **arrays)
    return path


def _results(rng, common, setting, quality):
    rows = []
    for name, ious in IOUS.items():
        recall = "class_recall_3D" if "evaluator" in setting else "recall"
        metrics = ("recall",) if name == "all" else ("AP_R40_3D", "AP_R40_BEV", recall)
        for metric, iou in product(metrics, ious):
            value = 90 - 60 * iou + 15 * quality + rng.normal()
            value -= 10 / setting.get("training.epochs", np.inf)
            if setting.get("evaluator") == "generalist":
                value = 20 + 90 - 60 * iou + 15 * (0.5 + quality) / 2 + 0.1 * rng.normal()
            boxes = name != "Cyclist"
            row = {**common, "class": name, "metric": metric, "iou": iou, "difficulty": "all"}
            row |= {"value": value if boxes else np.nan, "ground_truths": 420 if boxes else 0}
            rows.append(row)
    return rows


def _left_out(rng, results):
    """Every result without each of four routes and 34 individuals, which differ by some points.
    What a unit does is the same for all placements up to a tenth."""
    gone = ("difficulty", "value", "ground_truths")
    units = [("route", f"test {i}", 105) for i in range(4)]
    units += [("individual", f"test {i}", 30 if i < 10 else 5) for i in range(34)]
    shifts = {name: rng.normal() for _, name, _ in units}
    return [
        {k: v for k, v in row.items() if k not in gone}
        | {"unit": unit, "left_out": name, "ground_truths": number}
        | {"value": row["value"] + number / 100 * (shifts[name] + 0.1 * rng.normal())}
        for row in results
        if row["ground_truths"]
        for unit, name, number in units
    ]


def _distance(results):
    """AP that falls with the distance."""
    return [
        {k: v for k, v in row.items() if k != "difficulty"}
        | {"from_m": low, "to_m": low + 10, "value": row["value"] - low, "ground_truths": 210}
        for row in results
        if str(row["metric"]).startswith("AP_") and row["ground_truths"]
        for low in (0.0, 10.0)
    ]


def _sector(results):
    """Recall that is best ahead."""
    return [
        {k: v for k, v in row.items() if k != "difficulty"}
        | {"sector": sector, "from_deg": azimuth - 22.5, "to_deg": azimuth + 22.5}
        | {"value": row["value"] - abs(azimuth) / 9, "ground_truths": 140}
        for row in results
        if row["metric"] == "recall" and row["ground_truths"]
        for sector, azimuth in (("front right", -45.0), ("front", 0.0), ("front left", 45.0))
    ]


def _points(rng, quality, settings):
    return [
        {"placement": name, **setting, "class": object_class, "from_m": low, "to_m": low + 10}
        | {"objects": 100, "mean": mean, "median": 0.8 * mean, "p10": 0.1 * mean, "unseen": 0.05}
        for setting, (name, value) in product(settings, quality.items())
        for object_class in ("Car", "Pedestrian")
        for low, mean in ((0.0, 900 * (1 + value)), (10.0, 90 * (1 + value) + rng.random()))
    ]


def _individuals(settings, number):
    """Make individuals of every class on four routes: ten are in 30 frames, the others in five."""
    return [
        {**setting, "split": split, "scene": split, "route": i % 4, "class": object_class}
        | {"object_id": f"{object_class}-{i}", "boxes": 30 if i < 10 else 5}
        for setting, split in product(settings, ("train", "test"))
        for object_class, i in product(("Car", "Pedestrian"), range(number))
    ]


def _surrogates(rng, quality, settings):
    rows = []
    for setting, (name, value) in product(settings, quality.items()):
        for scale, object_class in enumerate(CLASSES, start=1):
            covered, h_pog = 1000 * scale * (1 + value + 0.1 * rng.random()), 4000.0 * scale
            rest, voxels = h_pog - covered, 9000 + 1000 * value
            values = {"s_mig": -covered, "ig": rest, "h_pog": h_pog, "covered_entropy": covered}
            values |= {"residual_entropy": rest, "m_sog": -covered / voxels}
            values["expected_points"] = 50 * scale * rng.random()
            values["expected_ig"] = 900 * scale * (1 + value + 0.2 * rng.random())
            values |= {"covered_voxels": voxels, "expected_recall": 1 - 1 / (2 + value)}
            row = {"placement": name, "class": object_class, **setting}
            row |= {"method": "cone", "seconds": 0.05}
            rows += [{**row, "surrogate": by, "value": number} for by, number in values.items()]
    return rows


def _curve(rng, trial, setting, flat):
    """An epoch over all frames takes 8 s; the loss is flat at the end or still falls."""
    seconds = 8 * setting.get("training.frame_share", 1.0)
    rows = []
    for epoch in range(1, setting.get("training.epochs", 5) + 1):
        loss = 2 / (3 if flat else epoch) + 0.1 * rng.random() * (not flat)
        for metric, value in (("loss", loss), ("seconds", seconds)):
            rows.append({"trial": trial, "epoch": epoch, "metric": metric, "value": value})
    return rows


def _accuracy(rng, names):
    rows = []
    ways = [("cone", 0.5, 0, 400), ("cone", 0.25, 0, 400), ("cone", 0.5, 0, 200)]
    ways += [(method, 0.5, steps, 400) for method in ("dda", "bresenham") for steps in (90, 1440)]
    columns = ("method", "resolution", "azimuth_steps", "frames")
    for name in names:
        exact = -1000 * (1 + rng.random())
        for way in ways:
            _, resolution, steps, _ = way
            error = 0.3 * (resolution - 0.25) + 5 / steps * rng.random() if steps else 0.0
            row = {"placement": name, "class": CLASSES[0], "surrogate": "s_mig"}
            row |= dict(zip(columns, way, strict=True))
            row |= dict.fromkeys(("value", "comparable"), exact * (1 - error))
            row |= {"reference": resolution == 0.25, "seconds": 0.01 + 1e-4 * steps}
            rows.append(row | {"pog_seconds": 0.1})
    return rows


def _sampling_error(rng, quality, settings):
    """Estimates of S-MIG, and resamples that all placements share but for a hair."""
    estimates, resamples = [], []
    for setting in settings:
        common = 50 * rng.normal(size=20)
        for name, value in quality.items():
            row = {"placement": name, **setting, "class": CLASSES[0], "surrogate": "s_mig"}
            exact = -1000 * (1 + value)
            drawn = exact + common + 0.1 * rng.normal(size=20)
            estimate = {"value": exact, "low": exact - 100, "high": exact + 100, "bias": 0.0}
            estimates.append({**row, **estimate, "sd": drawn.std(), "blocks": 10, "resamples": 20})
            resamples += [{**row, "resample": i, "value": v} for i, v in enumerate(drawn)]
    return estimates, resamples


def _tasks(trials):
    """Tasks of two workers, 10 ms beyond the work of each."""
    first = [("scene", "town01", "a", 31.0, True), ("pog", "Car", "b", 4.0, False)]
    if any(trial.get("evaluator") == "generalist" for trial in trials):
        first.append(("pretrain", "generalist", "c", 250.0, False))
    columns = ("stage", "label", "key", "seconds", "cached")
    rows = [dict(zip(columns, row, strict=True)) for row in first]
    for trial in trials:
        common = {"label": trial["placement"], "key": trial["trial"], "cached": False}
        rows.append({"stage": "simulate", **common, "seconds": 9.0})
        if trial["detector"] is not None:
            rows.append({"stage": "train", **common, "seconds": trial["seconds"]})
    free = [2.0, 2.0]
    for row in rows:
        record = {"started": np.nan, "ended": np.nan, "node": "", "peak_memory": np.nan}
        if not row["cached"]:
            worker = int(np.argmin(free))
            record |= {"started": free[worker], "ended": free[worker] + row["seconds"] + 0.01}
            record |= {"node": "node-1", "peak_memory": 2.5e8 + len(str(row["label"]))}
            free[worker] = record["ended"]
        row |= record | {"batch_size_reduced": False}
    return rows


def _write_maps(path, names, roi):
    edge = roi["resolution"]
    (x0, x1), (y0, y1) = roi["x"], roi["y"]
    x = np.arange(x0 + edge / 2, x1, edge)[:, None]
    y = np.arange(y0 + edge / 2, y1, edge)[None, :]
    road = np.exp(-((np.abs(y) - 3) ** 2)) * np.exp(-np.abs(x) / 30)
    maps = {f"pog/{c}": (i * road).astype(np.float32) for i, c in enumerate(CLASSES, start=1)}
    for i, name in enumerate(names):
        share = np.clip(0.5 + 0.5 * np.sin(np.hypot(x, y) * (1 + 0.1 * i)), 0, 1)
        maps[f"coverage/{name}"] = share.astype(np.float32)
        maps[f"residual/{name}"] = (road * (1 - share)).astype(np.float32)
    np.savez_compressed(path / "maps.npz", **maps)


def _write_frame(rng, path, names, points):
    boxes = np.array([[12, 3, 0.8, 4.2, 1.8, 1.6, 0.1], [8, -5, 0.9, 0.8, 0.8, 1.8, 0.0]])
    frame = {"boxes": boxes, "labels": np.array(["Car", "Pedestrian"])}
    for name in names:
        radius = np.round(rng.uniform(2, 18, points), 0) + 0.05 * rng.random(points)
        angle = rng.uniform(-np.pi, np.pi, points)
        cloud = [radius * np.cos(angle), radius * np.sin(angle), 0 * radius, rng.random(points)]
        frame[f"points/{name}"] = np.stack(cloud, axis=1).astype(np.float32)
        frame[f"lidar/{name}"] = rng.integers(0, 4, points).astype(np.uint8)
    np.savez_compressed(path / "frame.npz", **frame)

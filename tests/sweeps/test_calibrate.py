"""Curves from the detections in a store: those that made the detections are found again."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace import PAPER_PLACEMENTS, Lidar, Roi
from lidarplace.configuration.placement import read_placement
from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, GEOMETRY
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.recall.detection_curve import DetectionCurve, read_curves
from sweeps.calibration.curves_section import bins_of
from sweeps.calibration.left_out import check
from sweeps.calibration.observations import observations, rigs_of
from sweeps.commands.calibrate import app
from sweeps.plan.plan import read_plan
from sweeps.store.open import store_of
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import call, result

MOST, RATE = 0.9, 0.03
ROI = Roi((0, 40), (-20, 20), (0, 4), resolution=0.1)
SWEEP = {
    "classes": ["Car", "Pedestrian"],
    "lidar": {"azimuth_steps": 1800, "cloud_share": 0.2},
    "detector": "pointpillars_tiny",
    "grid": {"placement": ["line", "center", "line_roll"], "seed": [1, 2]},
}


def drawn(objects, seen, random):
    """Objects that are found by the curve."""
    p = MOST * (1 - np.exp(-RATE * seen.counts()))
    return objects.table[random.random(len(p)) < p]


def write_log(folder):
    """Four cars in each of 100 test frames, and one frame to train."""
    rng = np.random.default_rng(0)
    rows = [
        ("a", frame, frame / 10, f"{frame}-{k}", "Car", x, y, 0.8, 4.4, 1.8, 1.6, yaw)
        for frame in range(101)
        for k, (x, y, yaw) in enumerate(
            np.transpose([8 + 8 * np.arange(4), np.zeros(4), np.zeros(4)])
            + rng.uniform([-3, -15, -3], [3, 15, 3], (4, 3))
        )
    ]
    frames = pd.DataFrame({"scene": "a", "frame": range(101), "route": [0] + 100 * [1]})
    frames = frames.assign(timestamp_s=frames["frame"] / 10, split=["train"] + 100 * ["test"])
    write_box_log(folder, BoxLog(pd.DataFrame(rows, columns=list(BOX_COLUMNS)), frames))


@pytest.fixture
def config(tmp_path):
    write_log(tmp_path / "log")
    return write_sweep(tmp_path, **SWEEP)


def detect(config):
    """Keep scenes; the plan, and detections of each trial that follow the curve."""
    sweep, plan = read_plan(config)
    store = store_of(sweep)
    (task,) = [task for task in plan.tasks if task.stage.name == "scene"]
    log = task.stage.recording.record()
    store.save(task, log, 0.0)
    rng = np.random.default_rng(1)
    test = log.boxes[log.boxes["frame"] > 0]
    objects = CountedObjects.from_log(
        BoxLog(test, log.frames, log.buildings), ROI, ["Car"], 0.2, azimuth_share=0.2
    )
    detections = []
    for trial in plan.trials:
        name = trial.grid_point.point.placement
        lidar = replace(Lidar.paper(), azimuth_steps=1800)
        seen = objects.seen_by([PAPER_PLACEMENTS[name].with_lidar(lidar)])[0]
        detections.append((trial, drawn(objects, seen, rng)))
    return plan, store, detections


def keep(store, detections):
    for trial, boxes in detections:
        score = np.random.default_rng(2).random(len(boxes))
        scored = boxes[["frame", "class", *GEOMETRY]].assign(score=score)
        store.save(trial.evaluate, result(detections=scored), 0.0)


def run(*words, code=0):
    return " ".join(call(app, *words, code=code).output.split())


def test_the_curve_behind_the_detections_is_found(config, tmp_path):
    plan, store, every = detect(config)
    keep(store, every[:2])
    problem = "the store has detections of 1 rig(s), at least 2 are needed"
    assert problem in run(config, code=2)
    keep(store, every[2:3])
    assert "3 of 6 trials are evaluated" in run(config), "the others are left out"
    keep(store, every[3:])
    out = tmp_path / "curves.json"
    assert "6 of 6 trials are evaluated" in run(config, "--out", out)
    curves = read_curves(out)
    assert {(c.object_class, c.iou) for c in curves.curves} == {("Car", 0.5), ("Car", 0.7)}
    assert curves.of("Car", 0.7).most == pytest.approx(MOST, abs=0.04)
    assert curves.of("Car", 0.7).rate == pytest.approx(RATE, rel=0.15)
    rigs = rigs_of(plan.trials, store)
    assert list(rigs) == ["line", "center", "line_roll"]
    assert [len(trials) for trials in rigs.values()] == [2, 2, 2]
    seen = observations(rigs, store)
    center = seen[(seen["rig"] == "center") & (seen["iou"] == 0.5)].set_index("object_id")
    found_ids = [set(boxes["object_id"]) for trial, boxes in every if "center" in trial.label]
    for object_id, row in center.iterrows():
        assert row["found"] == np.mean([object_id in ids for ids in found_ids])
    group = seen[seen["iou"] == 0.7]
    checked = check(group)
    assert checked.rigs == 3
    assert checked.objects == checked.individuals == len(center)
    assert list(checked.left_out) == ["rig", "object"]
    for left_out in checked.left_out.values():
        assert left_out.brier < left_out.brier_of_mean
        assert left_out.error < 0.05
    means = group.groupby("rig")[["found", "cells"]].mean()
    p = group["cells"].map(lambda cells: float(checked.curve.probability(cells)))
    fitted = p.groupby(group["rig"]).mean()
    assert checked.rho_fitted == pytest.approx(fitted.corr(means["found"], method="spearman"))
    assert checked.left_out["rig"].spread == pytest.approx(means["found"].std())


def test_detections_from_elsewhere_have_curves_too(tmp_path):
    write_log(tmp_path / "log")
    log = read_box_log(tmp_path / "log")
    test = BoxLog(log.boxes[log.boxes["frame"] > 0], log.frames, log.buildings)
    objects = CountedObjects.from_log(test, ROI, ["Car"], 0.2)
    options = []
    for seed, (name, z) in enumerate({"low": 1.0, "high": 2.4}.items()):
        (tmp_path / f"{name}.yaml").write_text(f"mounts: [{{x: 0, y: 0, z: {z}}}]\n")
        lidar = Lidar.paper()
        (seen,) = objects.seen_by([read_placement(tmp_path / f"{name}.yaml", lidar)])
        rng = np.random.default_rng(seed)
        boxes = drawn(objects, seen, rng)
        detections = boxes[["frame", "class", *GEOMETRY]].assign(score=rng.random(len(boxes)))
        detections.to_parquet(tmp_path / f"{name}.parquet")
        options += ["--rig", f"{name}={tmp_path / name}.parquet"]
        options += ["--geometry", f"{name}={tmp_path / name}.yaml"]
    out = tmp_path / "curves.json"
    result = call(app, "--log", tmp_path / "log", *options, "--out", out)
    curve = read_curves(out).of("Car", 0.7)
    cells = np.array([10, 30, 60])
    expected = MOST * (1 - np.exp(-RATE * cells))
    assert curve.probability(cells) == pytest.approx(expected, abs=0.05)
    lines = [line.split() for line in result.output.splitlines() if line.startswith("Car")]
    assert [line[2] for line in lines if len(line) == 8] == ["rig", "object"] * 2
    assert "Left out" in out.with_suffix(".html").read_text()
    assert "One rig: none can be left out" in run("--log", tmp_path / "log", *options[:4])
    few = read_box_log(tmp_path / "log")
    few = replace(few, boxes=few.boxes[few.boxes["frame"] < 6], frames=few.frames[:6])
    write_box_log(tmp_path / "few", few)
    detections = pd.read_parquet(tmp_path / "low.parquet")
    detections[detections["frame"] < 6].to_parquet(tmp_path / "low.parquet")
    output = run("--log", tmp_path / "few", *options[:4], code=2)
    assert "class Car: too few individuals for a curve; expected at least 30, found 20" in output
    bare = run("--log", tmp_path / "log", *options[:2], code=2)
    assert "--geometry: missing for rig low" in bare
    run(code=2)


def test_bins_hold_every_object_once_and_their_intervals_count_individuals():
    rng = np.random.default_rng(3)
    cells = np.repeat(rng.integers(0, 200, 300), 4)
    curve = DetectionCurve.model_validate({"class": "Car", "iou": 0.5, "most": MOST, "rate": RATE})
    found = np.repeat(rng.random(300), 4) < curve.probability(cells)  # alike in all its frames
    seen = pd.DataFrame({"cells": cells, "points": 2 * cells, "found": found.astype(float)})
    seen = seen.assign(scene="a", object_id=np.repeat(np.arange(300), 4))
    bins, once = bins_of(seen, "cells", curve), bins_of(seen[::4], "cells", curve)
    assert bins["objects"].sum() == len(seen)
    assert bins["individuals"].sum() == 300
    assert (bins["found"] * bins["objects"]).sum() == pytest.approx(found.sum())
    pd.testing.assert_series_equal(bins["high"], once["high"])  # copies add no certainty
    within = (bins["low"] <= bins["expected"]) & (bins["expected"] <= bins["high"])
    assert within.sum() >= len(bins) - 2
    points = bins_of(seen, "points", curve)
    assert points["points"].tolist() == (2 * bins["cells"]).tolist()
    nothing = bins_of(seen.assign(cells=0), "cells", curve)
    assert (len(nothing), nothing["expected"].item()) == (1, 0.0)

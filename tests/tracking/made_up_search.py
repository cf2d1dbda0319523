"""A made-up folder of a search: every file that it leaves, small, with known structure."""

import json
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lidarplace import PAPER_PLACEMENTS, OccupancyGrid, Roi

ROI = {"x": [0.0, 20.0], "y": [-10.0, 10.0], "z": [0.0, 4.0], "resolution": 0.5}
ANGLES = {"roll_deg": [-20, 20], "pitch_deg": [-20, 20], "yaw_deg": [-20, 20]}
ROOF = {"name": "roof", "polygon": [[-0.8, -0.6], [0.6, -0.5], [0.6, 0.5], [-0.8, 0.6]]}
ROOF |= {"z": [1.7, 2.2]} | ANGLES
NOSE = {"name": "nose", "polygon": [[2.2, -0.7], [2.3, -0.7], [2.3, 0.7], [2.2, 0.7]]}
NOSE |= {"z": [0.6, 0.6]} | ANGLES
LIMITS = [
    {"name": "distance", "unit": "m", "limit": 0.2, "sense": "at least"},
    {"name": "own body", "unit": "%", "limit": 5.0, "sense": "at most"},
]
BOUND = {"value": 1250.0, "by_gains": 1300.0, "greedy": 1100.0, "gap_percent": 4.0}
BOUND |= {"candidates": 480, "best_value": 1200.0, "reason": None}
BODY = [[[-2.3, -0.95, 0.2], [2.3, 0.95, 0.9]], [[-1.6, -0.8, 0.9], [1.0, 0.8, 1.5]]]
GAIN = {"name": "expected_ig", "by": "expected_ig", "unit": "nats", "direction": "maximize"}
GAIN |= {"weights": {"Car": 1.0, "Cyclist": 1.0}}
PRICE = {"name": "price", "by": "price", "unit": "€", "direction": "minimize", "weights": None}
CLASSES = ("Car", "Cyclist")
RUN = "lidarplace run runs/made_up/sweep.yaml"
BASE = 1000.0  # value of the best of the paper's eight; the others are below
STRIDED = 0.99  # values as searched, by those with all rays


def write_search(
    path: Path,
    trials: int = 60,
    lidars: int = 4,
    feasible: bool = True,
    several: bool = False,
    complete: bool = True,
    found: str = "found_1",
    model: str = "paper",
    zone: str = "roof",
    seed: int = 0,
    **changes: Any,
) -> Path:
    """Write a folder of a search with one objective, expected_ig, or with the price as well.

    The best found rig is trial 7. Without `complete` only the two required files are written.
    Values of trials are as searched, those of rigs with all rays are larger by 1 / STRIDED.
    `changes` replace keys of search.json.
    """
    rng = np.random.default_rng(seed)
    path.mkdir(parents=True)
    table = _trials(rng, trials, lidars, feasible, several, model=model, zone=zone)
    table.to_parquet(path / "trials.parquet")
    best = _rig(table.iloc[min(7, trials - 1)], lidars, several)
    front = {found: best} if feasible else {}
    if several:  # of each lower price the trial of the largest value, if that is larger than below
        cheap = table[table["feasible"] & (table["value.price"] < best["values"]["price"])]
        top = cheap.loc[cheap.groupby("value.price")["value.expected_ig"].idxmax()]
        top = top[top["value.expected_ig"] == top["value.expected_ig"].cummax()]
        for i, (_, row) in enumerate(top[::-1].iterrows(), start=2):
            front[f"found_{i}"] = _rig(row, lidars, several)
    papers = {
        name: {"role": "paper", "mounts": [*map(astuple, placement.mounts)]}
        | {"models": ["paper"] * 4, "zones": [None] * 4, "feasible": 3.0 + i <= 5}
        | {"measures": {"distance": 0.2, "own body": 3.0 + i}}
        | _values(STRIDED * (BASE - 40 * i), 4000.0 if several else None)
        for i, (name, placement) in enumerate(PAPER_PLACEMENTS.items())
    }
    price = best["values"].get("price")
    greedy = best | {"role": "greedy"} | _values(1100.0, price)
    rigs = front | {"greedy": greedy} | papers
    search = {
        "name": "made up",
        "command": "lidarplace search examples/search.yaml",
        "seconds": 41.5,
        "objectives": [GAIN, PRICE] if several else [GAIN],
        "sampler": "tpe",
        "seed": seed,
        "batch_size": 8,
        "trials": trials,
        "evaluations": trials - 2,
        "repeated": 2,
        "feasible": int(table["feasible"].sum()),
        "sampler_seconds": 10.0,
        "evaluation_seconds": 30.0,
        "parameters": 6 * lidars + 1,
        "constraints": LIMITS,
        "classes": list(CLASSES),
        "roi": ROI,
        "frames": 200,
        "zones": [ROOF | {"name": zone}, NOSE],
        "vehicle": BODY,
        "models": {model: {"price": 1000.0, "beams": 16, "azimuth_steps": 5625}},
        "bound": BOUND,
        "best": list(front),
        "front": len(front) if several else None,
        "baseline": next(iter(papers)),
        "rigs": rigs,
        "commands": [{"what": "train detectors on it", "line": RUN}],
        "tracking_uri": None,
        "versions": {"optuna": "5.0.0"},
        "stride": {"azimuth_stride": 4, "relative_error": 0.002},
        "importance": {"lidar_1.z": 0.6, "lidar_1.roll": 0.4},
    } | changes
    (path / "search.json").write_text(json.dumps(search))
    if complete:
        _write_optional(path, rng, search)
    return path


def _trials(
    rng: np.random.Generator, n: int, lidars: int, feasible: bool, several: bool, **names: str
) -> pd.DataFrame:
    """Values rise to 1,200 at trial 7. Without `feasible` every trial breaks "own body"."""
    value = rng.uniform(700, 1150, n)
    value[min(7, n - 1)] = 1200.0
    body = rng.uniform(-3, -0.1, n) if feasible else rng.uniform(0.5, 3, n)
    distance = rng.uniform(-0.2, 0.05, n)
    distance[min(7, n - 1)] = -0.1
    if not feasible:
        body[min(3, n - 1)], distance[min(3, n - 1)] = 0.25, -0.1
    columns: dict[str, Any] = {"number": np.arange(n), "state": "COMPLETE"}
    columns |= {"feasible": (body <= 0) & (distance <= 0), "possible": True}
    columns |= {"value.expected_ig": value}
    columns |= {"violation.distance": distance, "violation.own body": body}
    columns["seconds"] = rng.uniform(0.01, 0.05, n)
    if several:
        columns["value.price"] = rng.integers(1, 6, n) * 1000.0
    if not feasible:  # a rig that breaks a constraint is not evaluated
        columns |= {"state": "PRUNED", "value.expected_ig": np.nan}
    for i in range(1, lidars + 1):
        columns |= {f"lidar_{i}.{key}": name for key, name in names.items()}
        for axis, low, high in (("x", -0.7, 0.5), ("y", -0.4, 0.4), ("z", 1.75, 2.15)):
            columns[f"lidar_{i}.{axis}_m"] = rng.uniform(low, high, n)
        for axis in ("roll", "pitch", "yaw"):
            columns[f"lidar_{i}.{axis}_deg"] = rng.uniform(-20, 20, n)
    return pd.DataFrame(columns)


def _rig(trial: pd.Series, lidars: int, several: bool) -> dict[str, Any]:
    rig: dict[str, Any] = {"role": "found", "mounts": [], "feasible": True}
    for i in range(1, lidars + 1):
        place = [float(trial[f"lidar_{i}.{axis}_m"]) for axis in "xyz"]
        turns = [trial[f"lidar_{i}.{angle}_deg"] for angle in ("roll", "pitch", "yaw")]
        rig["mounts"].append(place + np.radians(turns).tolist())
    rig |= {key: [trial[f"lidar_1.{key[:-1]}"]] * lidars for key in ("models", "zones")}
    price = float(trial["value.price"]) if several else None
    values = _values(float(trial["value.expected_ig"]), price)
    return rig | values | {"measures": {"distance": 0.3, "own body": 2.5}}


def _values(searched: float, price: float | None) -> dict[str, dict[str, float]]:
    further = {} if price is None else {"price": price}
    return {
        "values": {"expected_ig": searched / STRIDED} | further,
        "searched": {"expected_ig": searched} | further,
    }


def _write_optional(path: Path, rng: np.random.Generator, search: dict[str, Any]) -> None:
    seconds = np.arange(1.0, 6.0)
    bounds = [
        pd.DataFrame({"seconds": seconds, "bound": last + 200 / seconds, "kind": kind})
        for kind, last in (("gains", 1260.0), ("linear programme", 1210.0))
    ]
    pd.concat(bounds).to_parquet(path / "bound.parquet")
    steps = {"step": [1, 2], "gain": [800.0, 300.0], "value": [800.0, 1100.0]}
    pd.DataFrame(steps).assign(zone="roof", x_m=0.1).to_parquet(path / "greedy.parquet")
    names = [*search["best"][:1], search["baseline"]]
    cases = (("as designed", 1.0), ("mount off", 0.99), ("LiDAR 1 fails", 0.8))
    rows = [
        (rig, case, "expected_ig", 20, BASE * share, 0.97 * BASE * share, share)
        for rig in names
        for case, share in (*cases, ("scene: Town05, 120 cars", 1.2))
    ]
    columns = ["rig", "case", "objective", "draws", "value", "worst", "share"]
    pd.DataFrame(rows, columns=columns).to_parquet(path / "robustness.parquet")
    _verified(search, names).to_parquet(path / "verified.parquet")
    _write_maps(path, rng, names)


def _verified(search: dict[str, Any], names: list[str]) -> pd.DataFrame:
    rows = [
        {"rig": rig, "role": search["rigs"][rig]["role"], "class": name, "iou": iou}
        | {"value": 60 + 2.5 * (i == 0), "difference": 2.5 * (i == 0)}
        | {"surrogate": search["rigs"][rig]["values"]["expected_ig"]}
        for name, iou in (("Car", 0.7), ("Cyclist", 0.5))
        for i, rig in enumerate(names)
    ]
    ends = {"low": 58.0, "high": 64.0, "difference_low": 0.5, "difference_high": 4.5}
    return pd.DataFrame(rows).assign(metric="AP_R40_3D", seeds=3, **ends)


def _write_maps(path: Path, rng: np.random.Generator, names: list[str]) -> None:
    """The POG of made-up boxes, and a share of it unseen, more under the baseline (the last)."""
    roi = Roi(**ROI)
    maps = {}
    for name in CLASSES:
        n = 300
        boxes = pd.DataFrame({"frame": np.arange(n) % 40, "class": name})
        boxes = boxes.assign(x=rng.uniform(0, 20, n), scene=0, z=0.8, yaw=0.0)
        boxes["y"] = rng.choice([-4, 0, 4], n) + rng.normal(0, 0.5, n)
        boxes = boxes.assign(length=4.5, width=1.9, height=1.6)
        grid = OccupancyGrid.from_boxes(boxes, roi, object_class=name, frames=40)
        pog = grid.entropy.sum(axis=2).astype(np.float32)
        maps[f"pog/{name}"] = pog
        for i, rig in enumerate(names):
            share = np.clip(rng.uniform(0.1, 0.3, pog.shape) + 0.2 * (i == len(names) - 1), 0, 1)
            maps[f"unseen/{name}/{rig}"] = (pog * share).astype(np.float32)
    np.savez_compressed(path / "maps.npz", **maps)

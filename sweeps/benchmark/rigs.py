"""Rigs of the benchmark, the log of their traffic, and the results of their own detectors.

`rigs.yaml` is the configuration under which the detectors were trained, `log` its scene, the
tables are those of docs/findings.md; `studies/findings/benchmark.py` writes them."""

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog, of_split, read_box_log
from lidarplace.rigs.placement import PAPER_PLACEMENTS
from sweeps.plan.plan import read_plan
from sweeps.plan.trial import Trial

FOLDER = Path(__file__).parent
LOG = FOLDER / "log"
METRICS = {
    "Car AP @ 0.7": ("Car", "AP_R40_3D", 0.7),
    "Car AP @ 0.5": ("Car", "AP_R40_3D", 0.5),
    "Car AP over IoU": ("Car", "AP_R40_3D_mean", 0.0),
    "Car recall": ("Car", "class_recall_3D", 0.5),
    "Ped. AP": ("Pedestrian", "AP_R40_3D", 0.5),
    "Ped. recall": ("Pedestrian", "class_recall_3D", 0.5),
    "Cyc. AP": ("Cyclist", "AP_R40_3D", 0.5),
    "Cyc. recall": ("Cyclist", "class_recall_3D", 0.5),
    "recall of all": ("all", "recall", 0.5),
}
"""Class, metric and IoU of the detectors' results, by the words of docs/findings.md."""
HEADLINES = ("Car AP over IoU", "recall of all")
"""Metrics of the table."""


def trials(overrides: Sequence[str] = ()) -> dict[str, Trial]:
    """Plan every rig on the log of the package, without detector unless overrides name one."""
    scene = f"scene={{source: log, folder: {json.dumps(str(LOG))}, seed: 1}}"
    one = ["detector=null", "grid.evaluator=[specialist]", "grid.seed=[1]"]
    _, plan = read_plan(FOLDER / "rigs.yaml", [scene, *one, *overrides])
    return {trial.grid_point.point.placement: trial for trial in plan.trials}


@cache
def log_of(split: str) -> BoxLog:
    """Read the traffic's frames to train on ("train", all that a predictor sees) or to test on."""
    return of_split(read_box_log(LOG), split)


@cache
def populations() -> dict[str, list[str]]:
    """Name the rigs of each origin, those that carry four LiDARs of 16 beams, and all."""
    rigs = list(dict.fromkeys(read("reached")["placement"]))
    kinds = {"random": "random", "optimum": "optimised"}
    kind = {rig: kinds.get(rig.partition("_")[0], "other LiDARs") for rig in rigs}
    kind |= dict.fromkeys(PAPER_PLACEMENTS, "paper's")
    origins = ("paper's", "random", "optimised", "other LiDARs")
    by_origin = {name: [rig for rig in rigs if kind[rig] == name] for name in origins}
    by_origin["same LiDARs"] = [rig for rig in rigs if kind[rig] != "other LiDARs"]
    return by_origin | {"all": rigs}


@cache
def read(name: str) -> pd.DataFrame:
    """Read a table of the package.

    "reached": placement, seed, class, metric, iou, value (percent) of the rigs' own detectors;
    "left_out": the same without each route and individual; "predicted": predictor, placement,
    seconds, and a column for each of `METRICS`."""
    return pd.read_parquet(FOLDER / f"{name}.parquet")


def of(table: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Select rows of one of `METRICS`."""
    name, measure, iou = METRICS[metric]
    same = (table["class"] == name) & (table["metric"] == measure)
    return table[same & np.isclose(table["iou"], iou)]


def built_in() -> tuple[dict[str, pd.DataFrame], dict[str, float]]:
    """Read predictions, a row a rig, a column for each of `METRICS`, and seconds, by predictor."""
    table = read("predicted")
    values = {
        str(name): rows.set_index("placement")[list(METRICS)]
        for name, rows in table.groupby("predictor", sort=False)
    }
    return values, dict(zip(table["predictor"], table["seconds"], strict=True))

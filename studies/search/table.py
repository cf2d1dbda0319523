"""What the rig that a search found is worth, when detectors are trained for it and for the eight.

Run as `python studies/search/table.py [RUN]`. RUN, the folder of the verification, is written
to the tables beside this script first; without it they are read.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from rich import print as show
from scipy import stats

from lidarplace.command_line.terminal import table
from tracking.statistics.jackknife import combined, sample_error
from tracking.statistics.reliability import Noise

FOLDER = Path(__file__).parent
METRICS = (
    ("Car", "AP_R40_3D_mean", 0.0),
    ("Car", "AP_R40_3D", 0.7),
    ("Car", "AP_R40_3D", 0.5),
    ("Car", "class_recall_3D", 0.5),
    ("Cyclist", "AP_R40_3D", 0.5),
    ("Cyclist", "class_recall_3D", 0.5),
)
"""Class, metric, IoU; 0: over all of them."""
COLUMNS = ["placement", "seed", "class", "metric", "iou"]
JUDGED = (
    ("Car", "AP_R40_3D", 0.7),
    ("Car", "AP_R40_3D_mean", 0.0),
    ("Car", "mean_overlap", 0.0),
    ("all", "recall", 0.5),
)
"""What the generalists have told of the eleven rigs on the traffic of the choice: `judged.csv`."""
REFERENCE = "center"
"""The best of the paper's eight by the generalists, on the traffic of the choice."""


def main() -> None:
    """Print a row a rig and a column a metric: the mean, and the difference to REFERENCE."""
    if len(sys.argv) > 1:
        _write(Path(sys.argv[1]))
    results = pd.read_parquet(FOLDER / "results.parquet")
    left_out = pd.read_parquet(FOLDER / "left_out.parquet")
    rows: dict[str, list[str]] = {}
    for wanted in METRICS:
        y = _of(results, wanted).pivot_table(index="placement", columns="seed", values="value")
        without = _of(left_out, wanted)
        for name in y.mean(axis=1).sort_values(ascending=False).index:
            rows.setdefault(str(name), []).append(_cell(str(name), y, without))
    head = [f"{c} {metric} {iou:g}" for c, metric, iou in METRICS]
    show(table(f"percent; difference to {REFERENCE}, 95 %", ("", *head), list(_cells(rows))))
    agreement = [_agreement(results, wanted) for wanted in JUDGED]
    show(table("Spearman's rho", ("", "generalists", "two seeds", "bias"), agreement))


def _agreement(results: pd.DataFrame, wanted: tuple[str, str, float]) -> tuple[str, str, str, str]:
    """Of the generalists with the rigs' own detectors, and of two seeds of these."""
    judged = _of(pd.read_csv(FOLDER / "judged.csv"), wanted).set_index("placement")["value"]
    own = _of(results, wanted).pivot_table(index="placement", columns="seed", values="value")
    own = own.loc[judged.index]
    pairs = own.corr("spearman").to_numpy()[np.triu_indices(len(own.columns), 1)]
    rho = stats.spearmanr(judged, own.mean(axis=1)).statistic
    bias = (judged - own.mean(axis=1)).mean()
    name = "{} {} {:g}".format(*wanted)
    return name, f"{rho:.2f}", ", ".join(f"{pair:.2f}" for pair in pairs), f"{bias:+.1f}"


def _cells(rows: dict[str, list[str]]) -> list[tuple[str, ...]]:
    return [(name, *cells) for name, cells in rows.items()]


def _cell(name: str, y: pd.DataFrame, left_out: pd.DataFrame) -> str:
    """Seeds are pooled over all rigs; routes and individuals are those of this pair."""
    means = y.mean(axis=1)
    if name == REFERENCE:
        return f"{means[name]:.1f}"
    pair = left_out[left_out["placement"].isin([name, REFERENCE])]
    noise = combined(Noise.of(y.to_numpy()), sample_error(pair, paired=True))
    seeds = len(y.columns)
    half = stats.t.ppf(0.975, noise.degrees) * math.sqrt(2 * noise.variance / seeds)
    difference = means[name] - means[REFERENCE]
    low, high = difference - half, difference + half
    return f"{means[name]:.1f}, {difference:+.1f} ({low:+.1f} to {high:+.1f})"


def _of(rows: pd.DataFrame, wanted: tuple[str, str, float]) -> pd.DataFrame:
    object_class, metric, iou = wanted
    same = (rows["class"] == object_class) & (rows["metric"] == metric)
    return rows[same & ((rows["iou"] - iou).abs() < 1e-6)]


def _write(run: Path) -> None:
    """Only what is told here, of routes and individuals alone."""
    more = {"results": ["value"], "left_out": ["unit", "left_out", "ground_truths", "value"]}
    for name, own in more.items():
        rows = pd.read_parquet(run / f"{name}.parquet")
        if "unit" in rows:
            rows = rows[rows["unit"] != "half"]
        kept = pd.concat([_of(rows, wanted) for wanted in {*METRICS, *JUDGED}])
        kept[[*COLUMNS, *own]].to_parquet(FOLDER / f"{name}.parquet", index=False)


if __name__ == "__main__":
    main()

"""Subsets of a rig's LiDARs as placements: ranked by real and by simulated values."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.recall.detection_curve import IOU, DetectionCurves
from lidarplace.validation.cloud_frames import Seen
from lidarplace.validation.comparison import BELOW_M, rank_correlation

MOST_LIDARS = 6  # with all their subsets; of more LiDARs each by itself, all, and all but one

WHAT = ("real", "shipped", "corrected")
_COLUMNS = ["subset", "measure", "class", "objects", *WHAT]


def subsets(lidars: int) -> list[tuple[int, ...]]:
    """List the subsets of so many LiDARs, small ones first."""
    sizes = range(1, lidars + 1) if lidars <= MOST_LIDARS else (1, lidars - 1, lidars)
    return [own for size in sizes for own in combinations(range(lidars), size)]


def points_by_subset(objects: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Compute mean points on an object nearer than `BELOW_M`, of boxes counted by every LiDAR.

    Needs columns distance, and SOURCE/NAME for `SOURCES` and every name of a LiDAR. Returns columns
    subset, measure ("points"), class ("all"), objects, and `SOURCES`."""
    columns = {what: [f"{what}/{name}" for name in names] for what in WHAT}
    known = objects[objects["distance"] < BELOW_M].dropna(subset=columns["real"])
    rows = []
    for own in subsets(len(names)) if len(known) else ():
        means = (known[[columns[w][n] for n in own]].sum(axis=1).mean() for w in WHAT)
        label = " + ".join(names[n] for n in own)
        rows.append((label, "points", "all", len(known), *means))
    return pd.DataFrame(rows, columns=_COLUMNS)


def cells_by_subset(
    frames: Sequence[Seen],
    classes: NDArray[np.str_],
    near: NDArray[np.bool_],
    names: Sequence[str],
    curves: DetectionCurves,
) -> pd.DataFrame:
    """Compute mean cells of an object that are hit, and its probability to be found.

    Of frames with clouds, as `points_by_subset`: measures "cells" and "expected_recall", by class
    with a curve at `IOU`. `classes` and `near`, whether a box counts, are of the log's boxes."""
    every = np.concatenate([seen.rows for seen in frames] or [np.empty(0, np.int64)])
    of_class = np.where(near[every], classes[every], "")
    known = [str(name) for name in np.unique(of_class) if curves.has(name, IOU)]
    rows = []
    for own in subsets(len(names)) if frames else ():
        label = " + ".join(names[n] for n in own)
        counts = [np.concatenate([_counts(seen, what, own) for seen in frames]) for what in WHAT]
        for name in known:
            which = of_class == name
            cells = [count[which] for count in counts]
            found = [curves.of(name, IOU).probability(count) for count in cells]
            for measure, values in (("cells", cells), ("expected_recall", found)):
                means = (float(value.mean()) for value in values)
                rows.append((label, measure, name, int(which.sum()), *means))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _counts(seen: Seen, what: str, own: Sequence[int]) -> NDArray[np.int64]:
    """Count distinct cells of every object that some LiDARs hit together."""
    union = np.unique(np.concatenate([getattr(seen, what)[n] for n in own]), axis=0)
    return np.bincount(union[:, 0], minlength=len(seen.rows))


def agreement(table: pd.DataFrame) -> pd.DataFrame:
    """Compare rankings of subsets: Spearman's rho of real values and of each simulation.

    Returns columns measure, class, subsets, shipped, corrected; NaN of fewer than 3 subsets."""
    rows = []
    for (measure, name), part in table.groupby(["measure", "class"], sort=False):
        real = part["real"].to_numpy(np.float64)
        found = {w: rank_correlation(part[w].to_numpy(np.float64), real) for w in WHAT[1:]}
        rows.append({"measure": measure, "class": name, "subsets": len(part), **found})
    return pd.DataFrame(rows, columns=["measure", "class", "subsets", *WHAT[1:]])

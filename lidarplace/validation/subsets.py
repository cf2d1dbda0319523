"""Subsets of a rig's LiDARs as placements: ranked by real and by simulated values."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.recall.detection_curve import IOU, DetectionCurves
from lidarplace.validation.cloud_frames import CellHits
from lidarplace.validation.comparison import BELOW_M, rank_correlation

MOST_LIDARS = 6  # with all their subsets; of more LiDARs each by itself, all, and all but one

SOURCES = ("real", "shipped", "corrected")
_COLUMNS = ["subset", "measure", "class", "objects", *SOURCES]


def subsets(lidars: int) -> list[tuple[int, ...]]:
    """List the subsets of so many LiDARs, small ones first."""
    sizes = range(1, lidars + 1) if lidars <= MOST_LIDARS else (1, lidars - 1, lidars)
    return [subset for size in sizes for subset in combinations(range(lidars), size)]


def points_by_subset(objects: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Compute mean points on an object nearer than `BELOW_M`, of boxes counted by every LiDAR.

    Needs columns distance, and SOURCE/NAME for `SOURCES` and every name of a LiDAR. Returns columns
    subset, measure ("points"), class ("all"), objects, and `SOURCES`."""
    columns = {source: [f"{source}/{name}" for name in names] for source in SOURCES}
    near = objects[objects["distance"] < BELOW_M].dropna(subset=columns["real"])
    rows = []
    for subset in subsets(len(names)) if len(near) else ():
        means = (near[[columns[s][n] for n in subset]].sum(axis=1).mean() for s in SOURCES)
        label = " + ".join(names[n] for n in subset)
        rows.append((label, "points", "all", len(near), *means))
    return pd.DataFrame(rows, columns=_COLUMNS)


def cells_by_subset(
    frames: Sequence[CellHits],
    classes: NDArray[np.str_],
    near: NDArray[np.bool_],
    names: Sequence[str],
    curves: DetectionCurves,
) -> pd.DataFrame:
    """Compute mean cells of an object that are hit, and its probability to be found.

    Of frames with clouds, as `points_by_subset`: measures "cells" and "expected_recall", by class
    with a curve at `IOU`. `classes` and `near`, whether a box counts, are of the log's boxes."""
    boxes = np.concatenate([hits.rows for hits in frames] or [np.empty(0, np.int64)])
    class_of = np.where(near[boxes], classes[boxes], "")
    with_curve = [str(name) for name in np.unique(class_of) if curves.has(name, IOU)]
    rows = []
    for subset in subsets(len(names)) if frames else ():
        label = " + ".join(names[n] for n in subset)
        counts = [np.concatenate([_counts(hits, s, subset) for hits in frames]) for s in SOURCES]
        for name in with_curve:
            of_class = class_of == name
            cells = [count[of_class] for count in counts]
            recall = [curves.of(name, IOU).probability(count) for count in cells]
            for measure, values in (("cells", cells), ("expected_recall", recall)):
                means = (float(value.mean()) for value in values)
                rows.append((label, measure, name, int(of_class.sum()), *means))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _counts(hits: CellHits, source: str, subset: Sequence[int]) -> NDArray[np.int64]:
    """Count distinct cells of every object that some LiDARs hit together."""
    union = np.unique(np.concatenate([getattr(hits, source)[n] for n in subset]), axis=0)
    return np.bincount(union[:, 0], minlength=len(hits.rows))


def agreement(table: pd.DataFrame) -> pd.DataFrame:
    """Compare rankings of subsets: Spearman's rho of real values and of each simulation.

    Returns columns measure, class, subsets, shipped, corrected; NaN of fewer than 3 subsets."""
    rows = []
    for (measure, name), part in table.groupby(["measure", "class"], sort=False):
        real = part["real"].to_numpy(np.float64)
        rho = {s: rank_correlation(part[s].to_numpy(np.float64), real) for s in SOURCES[1:]}
        rows.append({"measure": measure, "class": name, "subsets": len(part), **rho})
    return pd.DataFrame(rows, columns=["measure", "class", "subsets", *SOURCES[1:]])

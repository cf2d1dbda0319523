"""Every subset of a rig's LiDARs is a placement: ranked by real and by simulated values."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.recall.detection_curve import IOU, DetectionCurves
from lidarplace.validation.cloud_frames import Seen
from lidarplace.validation.comparison import BELOW_M, rank_correlation

MOST_LIDARS = 6
"""With all their subsets; of more LiDARs each by itself, all, and all but one."""

WHAT = ("real", "shipped", "corrected")


def subsets(lidars: int) -> list[tuple[int, ...]]:
    """Subsets of so many LiDARs, small ones first."""
    sizes = range(1, lidars + 1) if lidars <= MOST_LIDARS else (1, lidars - 1, lidars)
    return [own for size in sizes for own in combinations(range(lidars), size)]


def points_by_subset(objects: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Mean points on an object nearer than `BELOW_M`, of the boxes that every LiDAR was counted in.

    Args:
        objects: columns distance, and WHAT/NAME for `WHAT` and every name.
        names: of the LiDARs.

    Returns:
        Columns subset, measure ("points"), class ("all"), objects, and `WHAT`.
    """
    columns = {what: [f"{what}/{name}" for name in names] for what in WHAT}
    known = objects[objects["distance"] < BELOW_M].dropna(subset=columns["real"])
    rows = []
    for own in subsets(len(names)) if len(known) else ():
        means = {w: known[[columns[w][n] for n in own]].sum(axis=1).mean() for w in WHAT}
        label = " + ".join(names[n] for n in own)
        label_of = {"subset": label, "measure": "points", "class": "all"}
        rows.append(label_of | {"objects": len(known), **means})
    return pd.DataFrame(rows, columns=["subset", "measure", "class", "objects", *WHAT])


def cells_by_subset(
    frames: Sequence[Seen],
    classes: NDArray[np.str_],
    near: NDArray[np.bool_],
    names: Sequence[str],
    curves: DetectionCurves,
) -> pd.DataFrame:
    """Mean cells of an object that are hit, and its probability to be found, of frames with clouds.

    Args:
        frames: what is seen.
        classes: of the log's boxes, shape (boxes,).
        near: whether a box counts, shape (boxes,).
        names: of the LiDARs.
        curves: detection curves, at `IOU`.

    Returns:
        As `points_by_subset`, measures "cells" and "expected_recall", by class with a curve.
    """
    known = sorted(
        {name for seen in frames for name in classes[seen.rows] if curves.has(name, IOU)}
    )
    rows = []
    for own in subsets(len(names)) if frames else ():
        label = " + ".join(names[n] for n in own)
        counts = {
            what: [_counts(getattr(seen, what), own, len(seen.rows)) for seen in frames]
            for what in WHAT
        }
        of_class = np.concatenate(
            [np.where(near[seen.rows], classes[seen.rows], "") for seen in frames]
        )
        for name in known:
            which = of_class == name
            if not which.any():
                continue
            cells = {what: np.concatenate(counts[what])[which] for what in WHAT}
            found = {what: curves.of(name, IOU).probability(own) for what, own in cells.items()}
            for measure, values in (("cells", cells), ("expected_recall", found)):
                means = {what: float(value.mean()) for what, value in values.items()}
                label_of = {"subset": label, "measure": measure, "class": name}
                rows.append(label_of | {"objects": int(which.sum()), **means})
    return pd.DataFrame(rows, columns=["subset", "measure", "class", "objects", *WHAT])


def _counts(
    cells: Sequence[NDArray[np.int64]], own: Sequence[int], objects: int
) -> NDArray[np.int64]:
    """Distinct cells of every object that LiDARs `own` hit together."""
    union = np.unique(np.concatenate([cells[n] for n in own]), axis=0)
    return np.bincount(union[:, 0], minlength=objects)


def agreement(table: pd.DataFrame) -> pd.DataFrame:
    """How alike subsets are ranked: Spearman's rho of real values and of each simulation.

    Returns columns measure, class, subsets, shipped, corrected; NaN of fewer than 3 subsets.
    """
    rows = []
    for (measure, name), part in table.groupby(["measure", "class"], sort=False):
        real = part["real"].to_numpy(np.float64)
        found = {w: rank_correlation(part[w].to_numpy(np.float64), real) for w in WHAT[1:]}
        rows.append({"measure": measure, "class": name, "subsets": len(part), **found})
    return pd.DataFrame(rows, columns=["measure", "class", "subsets", *WHAT[1:]])

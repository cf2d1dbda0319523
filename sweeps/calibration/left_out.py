"""Check of a detection curve by rigs, routes and objects that are left out of its fit."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.recall.baselines import ENOUGH_POINTS
from lidarplace.recall.detection_curve import DetectionCurve, fit

UNITS = {"rig": ["rig"], "route": ["route"], "object": ["scene", "object_id"]}
"""Columns that name what is left out, by its kind."""
LEAST_INDIVIDUALS = 30
"""Least number of individuals: the recall of 30 is known to 9 points (one standard error)."""
MOST_PARTS = 10
"""Most parts: more routes or objects are thrown together at random, as every part takes a fit."""


@dataclass(frozen=True)
class LeftOut:
    """Errors of a curve on each part of the observations that was not in its fit.

    Attributes:
        parts: their number.
        brier: mean squared difference of probability and what became of the object.
        brier_of_mean: the same of the share found in the other parts, for every object alike.
        error: mean distance of a part's predicted recall from the measured one.
        spread: standard deviation of the measured recall over the parts."""

    parts: int
    brier: float
    brier_of_mean: float
    error: float
    spread: float


@dataclass(frozen=True)
class Check:
    """Quality of the prediction of a class at an overlap.

    Attributes:
        curve: fitted to all observations.
        rigs, objects, individuals: what it was fitted to; objects and individuals of one rig.
        left_out: by `UNITS`; none of which there are not two.
        rho: Spearman's of the recall of rigs that are left out and the predicted one; NaN of one
            rig. A rig that is left out pulls the curve away from itself, so where the curve is flat
            this is negative, whatever is true.
        rho_fitted: the same with the curve that is fitted to all rigs.
        rho_log_points, rho_enough_points, rho_log_cells: of measures that are not fitted."""

    curve: DetectionCurve
    rigs: int
    objects: int
    individuals: int
    left_out: Mapping[str, LeftOut]
    rho: float
    rho_fitted: float
    rho_log_points: float
    rho_enough_points: float
    rho_log_cells: float


def check(seen: pd.DataFrame) -> Check:
    """Fit a curve to `observations` of one class and overlap, and leave parts of them out.

    Raises InputError: they are of fewer than `LEAST_INDIVIDUALS`."""
    name, iou = str(seen["class"].iloc[0]), float(seen["iou"].iloc[0])
    one = seen[seen["rig"] == seen["rig"].iloc[0]]
    individuals = len(one[["scene", "object_id"]].drop_duplicates())
    if individuals < LEAST_INDIVIDUALS:
        few, most = "too few individuals for a curve", f"at least {LEAST_INDIVIDUALS}"
        fix = "name the other classes with --class"
        raise InputError(few, place=f"class {name}", expected=most, found=individuals, fix=fix)
    whole = fit(name, iou, seen["cells"], seen["found"])
    left_out, expected = {}, seen["found"] * np.nan
    for unit, keys in UNITS.items():
        part = np.asarray(seen.groupby(keys, sort=True).ngroup(), np.int64)
        parts = int(part.max()) + 1
        if unit != "rig" and parts > MOST_PARTS:
            drawn = np.random.default_rng(0).permutation(parts) % MOST_PARTS
            part = np.asarray(drawn, np.int64)[part]
        if parts > 1:
            left_out[unit], predicted = _without_each(seen, part, name, iou)
            expected = predicted if unit == "rig" else expected
    measures = {
        "rho": expected,
        "rho_fitted": whole.probability(seen["cells"]),
        "rho_log_points": np.log1p(seen["points"]),
        "rho_enough_points": seen["points"] >= ENOUGH_POINTS,
        "rho_log_cells": np.log1p(seen["cells"]),
    }
    of_rig = seen.assign(**measures).groupby("rig")[["found", *measures]].mean()
    rho = of_rig.corr(method="spearman")["found"]
    return Check(
        curve=whole,
        rigs=len(of_rig),
        objects=len(one),
        individuals=individuals,
        left_out=left_out,
        **{name: float(rho[name]) for name in measures},
    )


def _without_each(
    seen: pd.DataFrame, part: NDArray[np.int64], name: str, iou: float
) -> tuple[LeftOut, pd.Series]:
    """Leave out every part; return also each object's probability by the curve of the others."""
    expected, mean = (pd.Series(np.nan, seen.index) for _ in range(2))
    for number in np.unique(part):
        left_out, others = part == number, seen[part != number]
        curve = fit(name, iou, others["cells"], others["found"])
        expected[left_out] = curve.probability(seen.loc[left_out, "cells"])
        mean[left_out] = others["found"].mean()
    table = pd.DataFrame({"found": seen["found"], "expected": expected})
    of_part = table.groupby(part).mean()
    errors = LeftOut(
        parts=len(of_part),
        brier=float(((expected - seen["found"]) ** 2).mean()),
        brier_of_mean=float(((mean - seen["found"]) ** 2).mean()),
        error=float((of_part["expected"] - of_part["found"]).abs().mean()),
        spread=float(of_part["found"].std()),
    )
    return errors, expected

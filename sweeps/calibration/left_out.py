"""Does a detection curve tell rigs apart that it was not fitted to? Each is left out in turn."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from lidarplace.recall.baselines import ENOUGH_POINTS
from lidarplace.recall.detection_curve import DetectionCurve, fit


@dataclass(frozen=True)
class Check:
    """How well a class at an overlap is predicted for rigs that are left out.

    Attributes:
        curve: fitted to all rigs.
        rigs, objects, individuals: what it was fitted to; objects and individuals of one rig.
        brier: mean squared difference of probability and what became of the object.
        brier_of_mean: the same of the share found under the other rigs, for every object alike.
        error: mean distance of a rig's predicted recall from the measured one.
        spread: standard deviation of the measured recall over the rigs.
        rho: Spearman's between the two. A rig that is left out pulls the curve away from itself,
            so where the curve is flat this is negative, whatever is true.
        rho_fitted: the same with the curve that is fitted to all rigs.
        rho_log_points, rho_enough_points, rho_log_cells: of measures that are not fitted.
    """

    curve: DetectionCurve
    rigs: int
    objects: int
    individuals: int
    brier: float
    brier_of_mean: float
    error: float
    spread: float
    rho: float
    rho_fitted: float
    rho_log_points: float
    rho_enough_points: float
    rho_log_cells: float


def check(seen: pd.DataFrame) -> Check:
    """Fit a curve to observations of one class and overlap, and leave each rig out.

    Args:
        seen: columns of `sweeps.calibration.observations`, two rigs or more.
    """
    name, iou = str(seen["class"].iloc[0]), float(seen["iou"].iloc[0])
    seen = seen.assign(expected=np.nan, mean=np.nan)
    for rig in seen["rig"].unique():
        left_out = seen["rig"] == rig
        others = seen[~left_out]
        curve = fit(name, iou, others["cells"], others["found"])
        seen.loc[left_out, "expected"] = curve.probability(seen.loc[left_out, "cells"])
        seen.loc[left_out, "mean"] = others["found"].mean()
    whole = fit(name, iou, seen["cells"], seen["found"])
    of_rig = (
        seen.assign(
            fitted=whole.probability(seen["cells"]),
            log_points=np.log1p(seen["points"]),
            enough_points=seen["points"] >= ENOUGH_POINTS,
            log_cells=np.log1p(seen["cells"]),
        )
        .groupby("rig")[["found", "expected", "fitted", "log_points", "enough_points", "log_cells"]]
        .mean()
    )
    rho = of_rig.corr(method="spearman")["found"]
    one = seen[seen["rig"] == seen["rig"].iloc[0]]
    return Check(
        curve=whole,
        rigs=len(of_rig),
        objects=len(one),
        individuals=len(one[["scene", "object_id"]].drop_duplicates()),
        brier=float(((seen["expected"] - seen["found"]) ** 2).mean()),
        brier_of_mean=float(((seen["mean"] - seen["found"]) ** 2).mean()),
        error=float((of_rig["expected"] - of_rig["found"]).abs().mean()),
        spread=float(of_rig["found"].std()),
        rho=float(rho["expected"]),
        rho_fitted=float(rho["fitted"]),
        rho_log_points=float(rho["log_points"]),
        rho_enough_points=float(rho["enough_points"]),
        rho_log_cells=float(rho["log_cells"]),
    )

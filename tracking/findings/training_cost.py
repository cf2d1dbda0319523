"""What shorter trainings and fewer frames cost in AP."""

from collections.abc import Sequence

import pandas as pd

from lidarplace.base.metrics import HEADLINE_METRIC
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.kitti_iou import headline_iou

COST_AXES = ("training.epochs", "training.frame_share")
"""Axes of a sweep that trade AP for seconds of training."""


def varied_cost_axes(results: pd.DataFrame) -> tuple[str, ...]:
    """Those of COST_AXES that the sweep varies."""
    return tuple(axis for axis in COST_AXES if axis in results and results[axis].nunique() > 1)


def is_longest(results: pd.DataFrame, axes: Sequence[str]) -> pd.Series:
    """Whether each row belongs to the longest training of its detector and setting of other axes.
    It has most epochs × share of the frames; of equal ones that of more different frames."""
    own = [axis for axis in COST_AXES if axis in results]
    keys = [results[key] for key in ("detector", *(axis for axis in axes if axis not in own))]
    longest = pd.Series(True, index=results.index)
    for amount in (results[own].prod(axis=1), *(results[axis] for axis in reversed(own))):
        rest = amount.where(longest)
        longest &= rest == rest.groupby(keys, dropna=False).transform("max")
    return longest


def training_cost(results: pd.DataFrame, curves: pd.DataFrame, axes: Sequence[str]) -> pd.DataFrame:
    """AP of every trial against the longest training of its placement, detector and seed.

    One row a trial and class with AP: trial, placement, detector, seed, axes, class, iou, ap
    (percent); seconds, of all its epochs; reference, whether it is the longest training;
    reference_ap, and error, reference_ap less ap: NaN where the longest training failed.
    """
    iou = {name: headline_iou(results, name) for name in results["class"].unique()}
    own = results[
        (results["metric"] == HEADLINE_METRIC) & (results["iou"] == results["class"].map(iou))
    ]
    own = own.dropna(subset="value").rename(columns={"value": "ap"})
    spent = curves[curves["metric"] == "seconds"].groupby("trial")["value"].sum()
    # A first epoch that also compiled is as long as it was: that is what a user waits for.
    own["seconds"] = own["trial"].map(spent)
    own["reference"] = is_longest(own, axes)
    same = ["placement", "detector", "seed", *(a for a in axes if a not in COST_AXES), "class"]
    reference = own.loc[own["reference"], [*same, "ap"]].rename(columns={"ap": "reference_ap"})
    table = own.merge(reference, on=same, how="left")
    table["error"] = table["reference_ap"] - table["ap"]
    columns = ["trial", "placement", "detector", "seed", *axes, "class", "iou", "ap", "seconds"]
    return table[[*columns, "reference", "reference_ap", "error"]]


def summarise_cost(cost: pd.DataFrame, axes: Sequence[str]) -> pd.DataFrame:
    """One row per class, detector and setting of the axes, the longest training first.

    Medians of seconds, means of AP and error with its sd over placements and seeds; kendall, the
    rank agreement of the placements' means with the longest training.
    """
    rows, keys = [], ["class", "detector", *axes]
    for key, own in cost.groupby(keys, sort=False, dropna=False):
        means = own.groupby("placement")[["ap", "reference_ap"]].mean().dropna()
        of_error = (own["error"].mean(), own["error"].std())
        tau = rank_agreement(means["ap"], means["reference_ap"])[1]
        measured = (len(own), own["seconds"].median(), own["ap"].mean(), *of_error)
        rows.append((*key, *measured, tau, bool(own["reference"].all())))
    columns = [*keys, "trials", "seconds", "ap", "error", "error_sd", "kendall", "reference"]
    return pd.DataFrame(rows, columns=columns).sort_values(
        ["class", "detector", "seconds"], ascending=[True, True, False], ignore_index=True
    )

"""Cost in AP of shorter trainings and fewer frames."""

from collections.abc import Sequence

import pandas as pd

from lidarplace.base.metrics import HEADLINE_METRIC
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.kitti_iou import headline_iou

COST_AXES = ("training.epochs", "training.frame_share")
"""Axes of a sweep that trade AP for seconds of training."""


def varied_cost_axes(results: pd.DataFrame) -> tuple[str, ...]:
    """Name the axes of `COST_AXES` that the sweep varies."""
    return tuple(axis for axis in COST_AXES if axis in results and results[axis].nunique() > 1)


def is_longest(results: pd.DataFrame, axes: Sequence[str]) -> pd.Series:
    """Tell of each row whether it belongs to the longest training of its detector and setting.

    The setting is that of other axes. The longest has most epochs × share of the frames; of equal
    ones that of more different frames."""
    costs = [axis for axis in COST_AXES if axis in results]
    keys = [results[key] for key in ("detector", *(axis for axis in axes if axis not in costs))]
    longest = pd.Series(True, index=results.index)
    for amount in (results[costs].prod(axis=1), *(results[axis] for axis in reversed(costs))):
        rest = amount.where(longest)
        longest &= rest == rest.groupby(keys, dropna=False).transform("max")
    return longest


def training_cost(results: pd.DataFrame, curves: pd.DataFrame, axes: Sequence[str]) -> pd.DataFrame:
    """Compare AP of every trial with the longest training of its placement, detector and seed.

    One row a trial and class with AP: trial, placement, detector, seed, axes, class, iou, ap
    (percent); seconds, of all its epochs; reference, whether it is the longest training;
    reference_ap, and error, reference_ap less ap: NaN where the longest training failed."""
    iou = {name: headline_iou(results, name) for name in results["class"].unique()}
    rows = results[
        (results["metric"] == HEADLINE_METRIC) & (results["iou"] == results["class"].map(iou))
    ]
    rows = rows.dropna(subset="value").rename(columns={"value": "ap"})
    spent = curves[curves["metric"] == "seconds"].groupby("trial")["value"].sum()
    # A first epoch that also compiled is as long as it was: that is what a user waits for.
    rows["seconds"] = rows["trial"].map(spent)
    rows["reference"] = is_longest(rows, axes)
    same = ["placement", "detector", "seed", *(a for a in axes if a not in COST_AXES), "class"]
    reference = rows.loc[rows["reference"], [*same, "ap"]].rename(columns={"ap": "reference_ap"})
    table = rows.merge(reference, on=same, how="left")
    table["error"] = table["reference_ap"] - table["ap"]
    columns = ["trial", "placement", "detector", "seed", *axes, "class", "iou", "ap", "seconds"]
    return table[[*columns, "reference", "reference_ap", "error"]]


def summarise_cost(cost: pd.DataFrame, axes: Sequence[str]) -> pd.DataFrame:
    """Summarise the cost per class, detector and setting of the axes, the longest training first.

    Medians of seconds, means of AP and error with its sd over placements and seeds; kendall, the
    rank agreement of the placements' means with the longest training."""
    rows, keys = [], ["class", "detector", *axes]
    for key, part in cost.groupby(keys, sort=False, dropna=False):
        means = part.groupby("placement")[["ap", "reference_ap"]].mean().dropna()
        of_error = (part["error"].mean(), part["error"].std())
        tau = rank_agreement(means["ap"], means["reference_ap"])[1]
        measured = (len(part), part["seconds"].median(), part["ap"].mean(), *of_error)
        rows.append((*key, *measured, tau, bool(part["reference"].all())))
    columns = [*keys, "trials", "seconds", "ap", "error", "error_sd", "kendall", "reference"]
    return pd.DataFrame(rows, columns=columns).sort_values(
        ["class", "detector", "seconds"], ascending=[True, True, False], ignore_index=True
    )

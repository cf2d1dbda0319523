"""Do two halves of the test frames agree about the placements?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from tracking.findings.paired import group_columns
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.statistics.reliability import reliability_of_mean


def agreement_of_halves(left_out: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """How alike halves of the test routes rank placements, by every metric.

    Args:
        left_out: `left_out.parquet`.
        axes: further axes of the grid.

    Returns:
        One row per (class, detector, axes, metric, iou) with three placements or more: `n`
        placements; `splits` of the routes; `agreement`, Spearman's rho between the halves, the mean
        over splits, of means over seeds; and `reliability`, what Spearman and Brown's formula makes
        of it for all routes, 0 where halves contradict each other.
    """
    keys = [key for key in group_columns(axes) if key != "difficulty"]
    halves = left_out[left_out["unit"] == "half"]
    rows = []
    for key, own in halves.groupby(keys, dropna=False, sort=False, observed=True):
        means = own.groupby(["left_out", "placement"])["value"].mean().unstack("left_out").dropna()
        splits = sorted({str(name)[:-1] for name in means})
        if len(means) < 3:
            continue
        rho = [rank_agreement(means[f"{one}a"], means[f"{one}b"])[0] for one in splits]
        agreement = float(np.mean(rho))
        reliable = float(reliability_of_mean(max(agreement, 0.0), 2)) if rho else np.nan
        if not np.isnan(agreement):
            rows.append((*key, len(means), len(splits), agreement, reliable))
    return pd.DataFrame(rows, columns=[*keys, "n", "splits", "agreement", "reliability"])

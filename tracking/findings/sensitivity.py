"""How much the placement moves AP and recall of a detector."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pandas as pd
from scipy import stats

CHANCE = 0.95
"""Share of sweeps of equal placements whose spread stays below `by_chance`."""


def sensitivity(means: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """The spread between the best and the worst placement.

    Args:
        means: `tracking.findings.summary.seed_means`.
        axes: further axes of the grid.

    Returns:
        One row per (class, detector, axes, metric, iou, difficulty) with at least two placements:
        `n` placements, the `best` and the `worst`, the `mean` over placements (percent), `spread`
        (best less worst, points), `relative` (spread / mean), and `by_chance`: what seeds alone
        would make of placements that are equal, in points, the 95 % quantile of the studentized
        range. NaN with one seed each.
    """
    keys = ["class", "detector", *axes, "metric", "iou", "difficulty"]
    columns = [*keys, "n", "best", "worst", "mean", "spread", "relative", "by_chance"]
    rows = []
    known = means[means["seeds"] > 0]
    for key, own in known.groupby(keys, dropna=False, sort=False):
        if len(own) < 2:
            continue
        values = own.set_index("placement")["mean"]
        spread, mean = float(values.max() - values.min()), float(values.mean())
        relative = spread / mean if mean > 0 else np.nan
        best, worst = values.idxmax(), values.idxmin()
        rows.append((*key, len(own), best, worst, mean, spread, relative, _by_chance(own)))
    return pd.DataFrame(rows, columns=columns)


@lru_cache(maxsize=256)
def _quantile(placements: int, freedom: int) -> float:
    return float(stats.studentized_range.ppf(CHANCE, placements, freedom))


def _by_chance(own: pd.DataFrame) -> float:
    freedom = own["seeds"] - 1
    if freedom.sum() < 1:
        return np.nan
    pooled = float(np.sqrt((freedom * own["sd"].fillna(0) ** 2).sum() / freedom.sum()))
    # Unequal numbers of seeds: Kramer's harmonic mean.
    seeds = stats.hmean(own["seeds"])
    return float(_quantile(len(own), int(freedom.sum())) * pooled / np.sqrt(seeds))

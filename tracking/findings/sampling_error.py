"""Does the choice of the POG's frames blur the ranking of the placements?"""

from itertools import combinations

import pandas as pd

from lidarplace.pog.surrogates.sampling_error import NORMAL_95

PAIR_COLUMNS = ("class", "surrogate", "placement", "other", "difference", "low", "high")


def paired_differences(estimates: pd.DataFrame, resamples: pd.DataFrame) -> pd.DataFrame:
    """Differences of two placements over the same draws of frames.

    What all placements gain from a draw cancels, so a difference is known better than its terms.

    Args:
        estimates: placement, class, surrogate, value.
        resamples: placement, class, surrogate, resample, value; the same draws for all placements.

    Returns:
        PAIR_COLUMNS: each pair once, the difference of the values of placement and other, and its
        95 % interval, bias taken off as in `lidarplace.pog.surrogates.sampling_error`; empty for
        one placement.
    """
    rows = []
    for (name, surrogate), own in estimates.groupby(["class", "surrogate"], sort=False):
        drawn = resamples[(resamples["class"] == name) & (resamples["surrogate"] == surrogate)]
        by_placement = drawn.pivot(index="resample", columns="placement", values="value")
        value = own.set_index("placement")["value"]
        for placement, other in combinations(value.index, 2):
            difference = value[placement] - value[other]
            spread = by_placement[placement] - by_placement[other]
            # As the interval of a value: about the value less its bias, as wide as the resamples.
            middle, half = 2 * difference - spread.mean(), NORMAL_95 * spread.std()
            low, high = middle - half, middle + half
            rows.append((name, surrogate, placement, other, difference, low, high))
    return pd.DataFrame(rows, columns=list(PAIR_COLUMNS))


def separated(pairs: pd.DataFrame) -> pd.Series:
    """Whether the interval of each difference leaves 0 out."""
    return (pairs["low"] > 0) | (pairs["high"] < 0)

"""How accurate are surrogates that were computed faster, and do they rank placements the same?"""

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

VARIANT = ("method", "resolution", "azimuth_steps", "frames")
"""Columns that tell how a surrogate was computed."""


def rank_agreement(values: ArrayLike, reference: ArrayLike) -> tuple[float, float]:
    """Spearman's rho and Kendall's tau-b; NaN for fewer than 3 values or constant ones."""
    a, b = np.asarray(values, float), np.asarray(reference, float)
    if len(a) < 3 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return np.nan, np.nan
    return float(stats.spearmanr(a, b).statistic), float(stats.kendalltau(a, b).statistic)


def relative_errors(table: pd.DataFrame) -> pd.DataFrame:
    """`table` of `lidarplace.pog.surrogates.error_against_time.accuracy` with errors of each row.

    `reference_value` is the reference of the same placement, class and surrogate, and
    `relative_error` the distance to it. `method_error` is the distance to the value that is as
    accurate but for its resolution. Relative to the absolute reference; NaN where that is 0.
    """
    keys = ["placement", "class", "surrogate"]
    reference = table.loc[table["reference"]]
    exact = table.merge(reference[[*keys, "method", "azimuth_steps", "frames"]])
    values = reference[[*keys, "comparable"]].rename(columns={"comparable": "reference_value"})
    same = exact[[*keys, "resolution", "comparable"]].rename(columns={"comparable": "_exact"})
    result = table.merge(values, on=keys).merge(same, on=[*keys, "resolution"])
    for error, to in (("relative", result["reference_value"]), ("method", result.pop("_exact"))):
        distance = (result["comparable"] - to).abs()
        result[f"{error}_error"] = distance / to.abs().replace(0, np.nan)
    return result


def summarise(errors: pd.DataFrame) -> pd.DataFrame:
    """One row per class, surrogate and VARIANT, over placements: median and worst errors, rank
    agreement with the reference, median seconds."""
    groups = errors.groupby(["class", "surrogate", *VARIANT], sort=False)
    found = groups.agg(
        placements=("comparable", "size"),
        reference=("reference", "all"),
        median_error=("relative_error", "median"),
        worst_error=("relative_error", "max"),
        median_method_error=("method_error", "median"),
        worst_method_error=("method_error", "max"),
    )
    rows = [rank_agreement(own["comparable"], own["reference_value"]) for _, own in groups]
    ranks = pd.DataFrame(rows, found.index, ["spearman", "kendall"])
    seconds = groups[["seconds", "pog_seconds"]].median()
    return pd.concat([found, ranks, seconds], axis=1).reset_index()


def varied(summary: pd.DataFrame) -> pd.Series:
    """What each row of one class and surrogate varies: resolution, frames or its method's rays."""
    best = summary[summary["reference"]].iloc[0]
    exact = summary[["method", "azimuth_steps"]].eq(best[["method", "azimuth_steps"]]).all(axis=1)
    what = (summary["method"] + ", azimuth steps").mask(exact, best["method"] + ", resolution")
    return what.mask(exact & (summary["frames"] < best["frames"]), best["method"] + ", frames")

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
    accurate but for its resolution, so it shows methods, azimuth steps and frames alone. Relative
    to the absolute reference, >= 0; NaN where that is 0.
    """
    keys = ["placement", "class", "surrogate"]
    how = ["method", "azimuth_steps", "frames"]
    reference = table.loc[table["reference"], [*keys, *how, "comparable"]]
    exact = table.merge(reference[[*keys, *how]])[[*keys, "resolution", "comparable"]]
    result = table.merge(
        reference[[*keys, "comparable"]].rename(columns={"comparable": "reference_value"}), on=keys
    ).merge(exact.rename(columns={"comparable": "_exact"}), on=[*keys, "resolution"])
    value, best = result["comparable"], result["reference_value"]
    result["relative_error"] = (value - best).abs() / best.abs().replace(0, np.nan)
    same = result.pop("_exact")
    result["method_error"] = (value - same).abs() / same.abs().replace(0, np.nan)
    return result


def summarise(errors: pd.DataFrame) -> pd.DataFrame:
    """One row per class, surrogate and VARIANT, over placements.

    Columns: placements; reference; median and worst of relative_error and method_error; spearman
    and kendall, the rank agreement of the placements with the reference; seconds and pog_seconds,
    medians.
    """
    rows = []
    keys = ["class", "surrogate", *VARIANT]
    for key, group in errors.groupby(keys, sort=False):
        rho, tau = rank_agreement(group["comparable"], group["reference_value"])
        rows.append(
            dict(zip(keys, key, strict=True))
            | {
                "placements": len(group),
                "reference": bool(group["reference"].all()),
                "median_error": group["relative_error"].median(),
                "worst_error": group["relative_error"].max(),
                "median_method_error": group["method_error"].median(),
                "worst_method_error": group["method_error"].max(),
                "spearman": rho,
                "kendall": tau,
                "seconds": group["seconds"].median(),
                "pog_seconds": group["pog_seconds"].median(),
            }
        )
    return pd.DataFrame(rows)


def varied(summary: pd.DataFrame) -> pd.Series:
    """What each row of one class and surrogate varies: resolution, frames or its method's rays."""
    best = summary[summary["reference"]].iloc[0]
    exact = (summary["method"] == best["method"]) & (
        summary["azimuth_steps"] == best["azimuth_steps"]
    )
    what = summary["method"] + ", azimuth steps"
    what = what.mask(exact, best["method"] + ", resolution")
    return what.mask(exact & (summary["frames"] < best["frames"]), best["method"] + ", frames")

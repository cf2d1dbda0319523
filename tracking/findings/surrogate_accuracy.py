"""Accuracy of surrogates that were computed faster, and whether they rank placements the same."""

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

VARIANT = ("method", "resolution", "azimuth_steps", "frames")
"""Columns that distinguish how a surrogate was computed."""


def rank_agreement(values: ArrayLike, reference: ArrayLike) -> tuple[float, float]:
    """Compute Spearman's rho and Kendall's tau-b; NaN for fewer than 3 values or constant ones."""
    a, b = np.asarray(values, float), np.asarray(reference, float)
    if len(a) < 3 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return np.nan, np.nan
    return float(stats.spearmanr(a, b).statistic), float(stats.kendalltau(a, b).statistic)


def relative_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Add the errors of each row to `lidarplace.pog.surrogates.error_against_time.accuracy`.

    `reference_value` is the reference of the same placement, class and surrogate, and
    `relative_error` the distance to it. `method_error` is the distance to the value that is as
    accurate but for its resolution. Relative to the absolute reference; NaN where that is 0."""
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
    """Summarise errors over placements: a row per class, surrogate and `VARIANT`.

    Median and worst errors, rank agreement with the reference, median seconds."""
    groups = errors.groupby(["class", "surrogate", *VARIANT], sort=False)
    errors_of_variants = groups.agg(
        placements=("comparable", "size"),
        reference=("reference", "all"),
        median_error=("relative_error", "median"),
        worst_error=("relative_error", "max"),
        median_method_error=("method_error", "median"),
        worst_method_error=("method_error", "max"),
    )
    rows = [
        rank_agreement(of_variant["comparable"], of_variant["reference_value"])
        for _, of_variant in groups
    ]
    ranks = pd.DataFrame(rows, errors_of_variants.index, ["spearman", "kendall"])
    seconds = groups[["seconds", "pog_seconds"]].median()
    return pd.concat([errors_of_variants, ranks, seconds], axis=1).reset_index()


def varied(summary: pd.DataFrame) -> pd.Series:
    """Name what each row of a surrogate varies: resolution, frames or its method's rays."""
    best = summary[summary["reference"]].iloc[0]
    exact = summary[["method", "azimuth_steps"]].eq(best[["method", "azimuth_steps"]]).all(axis=1)
    variant = (summary["method"] + ", azimuth steps").mask(exact, best["method"] + ", resolution")
    return variant.mask(exact & (summary["frames"] < best["frames"]), best["method"] + ", frames")

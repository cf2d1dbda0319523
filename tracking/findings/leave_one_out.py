"""Does a correlation hang on one placement, and does it predict a placement not measured?"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tracking.findings.paired import group_columns, paired
from tracking.statistics.coefficients import COEFFICIENTS, scores
from tracking.statistics.reliability import seed_mean
from tracking.statistics.straight_line import left_out_means, left_out_predictions, rmse

LEAST_PLACEMENTS = 4
"""With fewer, the placements left determine a line."""

_COLUMNS = tuple(f"{name}_{suffix}" for name in COEFFICIENTS for suffix in ("min", "max", "most"))


def leave_one_out(
    results: pd.DataFrame, surrogates: pd.DataFrame, axes: Sequence[str] = ()
) -> pd.DataFrame:
    """Each coefficient without each placement in turn, and the error of predicting it.

    Args:
        results, surrogates, axes: see `tracking.findings.paired.paired`.

    Returns:
        One row per (class, detector, axes, metric, iou, difficulty, surrogate), in the order of
        `tracking.findings.correlation.correlate`: `n` placements; for each of pearson, spearman and
        kendall `_min` and `_max`, the range of the coefficient without one placement, and `_most`,
        without which it changes most; `rmse`, in the unit of the metric, of predicting each
        placement by the straight line of the surrogate through the others, and `rmse_of_mean`, by
        their mean: a surrogate that says anything has the smaller `rmse`. NaN and "" with fewer
        than 4 placements or a constant; `note` says which.

    Raises:
        ValueError: a column is missing, or a row occurs twice.
    """
    rows: list[dict[str, object]] = []
    for group in paired(results, surrogates, axes):
        found: dict[str, dict[str, object]] = {}
        for placements, names in group.by_placements():
            y = seed_mean(group.metric.loc[placements].to_numpy(np.float64))
            known = group.surrogates.loc[placements, names].to_numpy(np.float64).T
            for name, x in zip(names, known, strict=True):
                found[name] = _without_each(x, y, [str(label) for label in placements])
        rows += [
            {**group.group, "surrogate": name, **found[str(name)]} for name in group.surrogates
        ]
    columns = [*group_columns(axes), "surrogate", "n", *_COLUMNS, "rmse", "rmse_of_mean", "note"]
    return pd.DataFrame(rows, columns=columns)


def _without_each(
    x: NDArray[np.float64], y: NDArray[np.float64], placements: list[str]
) -> dict[str, object]:
    n = len(y)
    row: dict[str, object] = {"n": n, "rmse": np.nan, "rmse_of_mean": np.nan, "note": ""}
    row |= {name: "" if name.endswith("_most") else np.nan for name in _COLUMNS}
    if n < LEAST_PLACEMENTS:
        return row | {"note": f"fewer than {LEAST_PLACEMENTS} placements"}
    for what, values in (("the surrogate", x), ("the metric", y)):
        if np.isnan(scores(values, "pearson")).any():
            return row | {"note": f"{what} is the same for every placement"}
    for coefficient in COEFFICIENTS:
        whole = scores(x, coefficient) @ scores(y, coefficient)
        left = _coefficients_without_each(x, y, coefficient)
        if np.isfinite(left).any():
            row[f"{coefficient}_min"], row[f"{coefficient}_max"] = np.nanmin(left), np.nanmax(left)
            change = np.round(np.abs(left - whole), 12)  # of equal ones the first, on any machine
            row[f"{coefficient}_most"] = placements[int(np.nanargmax(change))]
    row["rmse"] = rmse(left_out_predictions(x[:, None], y)[0], y)
    row["rmse_of_mean"] = rmse(left_out_means(y), y)
    return row


def _coefficients_without_each(
    x: NDArray[np.float64], y: NDArray[np.float64], coefficient: str
) -> NDArray[np.float64]:
    """The coefficient without each of the n pairs, shape (n,)."""
    n = len(y)
    if coefficient != "kendall":
        others = np.arange(n - 1) + (np.arange(n - 1) >= np.arange(n)[:, None])
        products = scores(x[others], coefficient) * scores(y[others], coefficient)
        return np.asarray(products.sum(axis=1))
    # The pairs of all n are one table, from which each placement takes its own row away.
    a, b = np.sign(x[:, None] - x), np.sign(y[:, None] - y)
    agree, in_x, in_y = (
        table.sum() - 2 * table.sum(axis=1) for table in (a * b, np.abs(a), np.abs(b))
    )
    length = np.sqrt(in_x * in_y)
    return np.where(length > 0, agree / np.where(length > 0, length, 1.0), np.nan)

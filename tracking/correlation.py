"""How well the surrogates of a sweep's placements predicted AP and recall."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tracking.bootstrap import bootstrap_intervals
from tracking.coefficients import COEFFICIENTS, scores
from tracking.permutation import LARGEST_EXACT, permutation_p, smallest_p

ADDITIVE = (
    "s_mig",
    "ig",
    "h_pog",
    "covered_entropy",
    "residual_entropy",
    "expected_points",
    "expected_ig",
)
"""Surrogates that may be summed over classes."""

FEW_PLACEMENTS = 6

_ESTIMATES = tuple(
    f"{coefficient}{suffix}"
    for coefficient in COEFFICIENTS
    for suffix in ("", "_low", "_high", "_p")
)


def correlate(
    results: pd.DataFrame,
    surrogates: pd.DataFrame,
    axes: Sequence[str] = (),
    resamples: int = 2000,
    seed: int = 0,
) -> pd.DataFrame:
    """Correlate every surrogate with every metric over the placements of a sweep.

    A placement counts with its mean over seeds. No sign is assumed: tests are two-sided.
    Intervals are 95 % percentile intervals of a bootstrap that resamples placements and, within
    each, seeds; so they contain the seed-to-seed spread. p-values are permutation tests, exact up
    to 8 placements. With few seeds the bootstrap understates their spread by (s - 1) / s; and
    where placements are in perfect order it finds no spread at all: the note says so.

    Results of class "all" (recall over all objects) are compared with the surrogate summed over
    classes, the paper's sum, for the surrogates of `ADDITIVE`. `m_sog` is a mean and
    `covered_voxels` the same number for every class: neither has a sum with a meaning.

    Args:
        results: one row per (placement, class, detector, seed, axes, metric, iou, difficulty).
        surrogates: one row per (placement, class, surrogate) and those of the axes that it depends
            on; a missing value in such a column stands for any value.
        axes: further axes of the grid, columns of `results`.
        resamples: number of bootstrap resamples.
        seed: of the bootstrap, and of the permutations beyond 8 placements.

    Returns:
        One row per (class, detector, axes, metric, iou, difficulty, surrogate): `n` placements,
        the smallest number of `seeds`, and for each of pearson, spearman and kendall the value,
        `_low`, `_high` and `_p`; `exact`, whether p is from all permutations; `note`, why there
        is no number or what to keep in mind; `pairs_tested`, how many rows of this table have
        a coefficient, to judge how many small p-values chance alone would give.

    Raises:
        ValueError: a column is missing, or a row occurs twice.
    """
    keys = ["class", "detector", *axes, "metric", "iou", "difficulty"]
    _need(results, ["placement", "seed", "value", *keys], "results")
    _need(surrogates, ["placement", "class", "surrogate", "value"], "surrogates")
    depends = [axis for axis in axes if axis in surrogates.columns]
    predictors = with_sums(surrogates, axes)
    rows: list[dict[str, object]] = []
    for key, group in results.groupby(keys, dropna=False, sort=True, observed=True):
        names = dict(zip(keys, key, strict=True))
        y = _pivot(group, "seed", "results")
        x = _pivot(_matching(predictors, names, depends), "surrogate", "surrogates")
        for surrogate, estimates in _estimates(x, y, resamples, seed):
            rows.append({**names, "surrogate": surrogate, **estimates})
    columns = [*keys, "surrogate", "n", "seeds", *_ESTIMATES, "exact", "note"]
    table = pd.DataFrame(rows, columns=columns)
    table["pairs_tested"] = int(table["pearson"].notna().sum())
    return table


def _estimates(
    x: pd.DataFrame, y: pd.DataFrame, resamples: int, seed: int
) -> list[tuple[str, dict[str, object]]]:
    """All estimates of each surrogate (columns of `x`) against the metric (seeds are columns)."""
    y = y[y.notna().any(axis=1)]
    estimates: dict[str, dict[str, object]] = {}
    # Surrogates known for the same placements are done in one go.
    known = {name: tuple(y.index.intersection(x.index[x[name].notna()])) for name in x.columns}
    for placements in dict.fromkeys(known.values()):
        names = [name for name in x.columns if known[name] == placements]
        at = list(placements)
        block = _block(
            x.loc[at, names].to_numpy(np.float64).T, y.loc[at].to_numpy(np.float64), resamples, seed
        )
        for name, row in zip(names, block, strict=True):
            estimates[name] = row
            if row["note"] == "constant":
                row["note"] = f"{name} is the same for every placement"
    return [(name, estimates[name]) for name in x.columns]


def _block(
    x: NDArray[np.float64], y: NDArray[np.float64], resamples: int, seed: int
) -> list[dict[str, object]]:
    """Estimates of each row of `x` (k, n) against the seed means of `y` (n, seeds)."""
    n = len(y)
    seeds = int(np.isfinite(y).sum(axis=1).min()) if n else 0
    rows: list[dict[str, object]] = [
        {"n": n, "seeds": seeds, **dict.fromkeys(_ESTIMATES, np.nan), "exact": n <= LARGEST_EXACT}
        for _ in x
    ]
    if n < 3:
        note = "no value: the class has no ground truth" if n == 0 else "fewer than 3 placements"
        return [{**row, "note": note} for row in rows]
    mean = np.nanmean(y, axis=1)
    for coefficient in COEFFICIENTS:
        values = scores(x, coefficient) @ scores(mean, coefficient)
        p = permutation_p(x, mean, coefficient, seed)
        bounds = bootstrap_intervals(x, y, coefficient, resamples, seed)
        bounds[np.isnan(values)] = np.nan
        for i, row in enumerate(rows):
            row[coefficient] = values[i]
            row[f"{coefficient}_low"], row[f"{coefficient}_high"] = bounds[i]
            row[f"{coefficient}_p"] = p[i]
    notes = []
    if n < FEW_PLACEMENTS:
        notes.append(f"few placements: the smallest possible two-sided p is {smallest_p(n):.2g}")
    if seeds < 2:
        notes.append("a placement has one seed: the interval lacks its spread")
    flat = np.isnan(scores(mean, "pearson")).any()
    for i, row in enumerate(rows):
        if flat:
            row["note"] = "the metric is the same for every placement"
        elif np.isnan(scores(x[i], "pearson")).any():
            row["note"] = "constant"
        else:
            own = [
                f"{name}: all resamples agree, so it has no interval"
                for name in COEFFICIENTS
                if row[f"{name}_high"] - row[f"{name}_low"] < 1e-9  # type: ignore[operator]
            ]
            row["note"] = "; ".join([*notes, *own])
    return rows


def with_sums(surrogates: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """`surrogates` with rows of class "all" added: those of `ADDITIVE` summed over classes.

    A sum is NaN if the surrogate is NaN for a class. Keeps placement, class, surrogate, value and
    those of `axes` that are columns.
    """
    depends = [axis for axis in axes if axis in surrogates.columns]
    single = surrogates[["placement", "class", *depends, "surrogate", "value"]]
    total = (
        single[single["surrogate"].isin(ADDITIVE)]
        .groupby(["placement", *depends, "surrogate"], dropna=False, sort=False)["value"]
        .agg(lambda values: values.sum(skipna=False))
    )
    return pd.concat([single, total.reset_index().assign(**{"class": "all"})], ignore_index=True)


def _matching(
    predictors: pd.DataFrame, names: dict[str, object], depends: list[str]
) -> pd.DataFrame:
    """Rows of the class and of the axes' values in `names`; a missing value matches any."""
    match = predictors["class"] == names["class"]
    for axis in depends:
        match &= (predictors[axis] == names[axis]) | predictors[axis].isna()
    return predictors[match]


def _pivot(table: pd.DataFrame, columns: str, source: str) -> pd.DataFrame:
    """Placements as rows, `columns` as columns, in order of appearance."""
    twice = table.duplicated(["placement", columns])
    if twice.any():
        row = table[twice].iloc[0]
        raise ValueError(
            f"{source}: placement {row['placement']!r}, class {row['class']!r} has two values for "
            f"{columns} {row[columns]}; name the axis that tells them apart in `axes`"
        )
    wide = table.pivot(index="placement", columns=columns, values="value")
    return wide.reindex(index=table["placement"].unique(), columns=table[columns].unique())


def _need(table: pd.DataFrame, columns: list[str], source: str) -> None:
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise ValueError(
            f"{source} has no column {', '.join(missing)}; found {', '.join(map(str, table))}"
        )

"""Surrogates and metrics of the same placements, brought side by side."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.files.columns import check_columns
from lidarplace.pog.surrogates.table import SURROGATES


@dataclass(frozen=True)
class Paired:
    """All surrogates and one metric of one group, a value of each of `group_columns`.

    `surrogates` have a row a placement, may have other placements than `metric`, and missing
    values; `metric` has a row a placement and a column a seed, and a number in every row.
    """

    group: dict[str, object]
    surrogates: pd.DataFrame
    metric: pd.DataFrame

    def by_placements(self) -> list[tuple[list[object], list[str]]]:
        """Placements that have the metric and a surrogate, and all surrogates known for these."""
        placements = self.metric.index
        known = self.surrogates.reindex(placements).notna().to_numpy()
        alike: dict[bytes, list[int]] = {}
        for i, column in enumerate(known.T):
            alike.setdefault(column.tobytes(), []).append(i)
        return [
            (placements[known[:, own[0]]].tolist(), [str(self.surrogates.columns[i]) for i in own])
            for own in alike.values()
        ]


def group_columns(axes: Sequence[str]) -> list[str]:
    """Columns of `results` within which placements are compared."""
    return ["class", "detector", *axes, "metric", "iou", "difficulty"]


def paired(
    results: pd.DataFrame, surrogates: pd.DataFrame, axes: Sequence[str] = ()
) -> Iterator[Paired]:
    """Every group of `results` with its surrogates, sorted by `group_columns`.

    Results of class "all" (recall over all objects) meet the surrogates `with_sums`. A missing
    value in a column of detector or axes of `surrogates` stands for any value; `axes` are columns
    of `results`. Raises ValueError: a column is missing, or a row occurs twice.
    """
    keys = group_columns(axes)
    check_columns(list(results.columns), ["placement", "seed", "value", *keys], "results")
    needed = ("placement", "class", "surrogate", "value")
    check_columns(list(surrogates.columns), needed, "surrogates")
    depends = _depends(surrogates, axes)
    predictors = with_sums(surrogates, axes)
    tables: dict[tuple[object, ...], pd.DataFrame] = {}  # every metric of a class has the same
    for key, rows in results.groupby(keys, dropna=False, sort=True, observed=True):
        group = dict(zip(keys, key, strict=True))
        metric = _pivot(rows, "seed", "results")
        setting = tuple(group[name] for name in ("class", *depends))
        if setting not in tables:
            own = matching(predictors, dict(zip(("class", *depends), setting, strict=True)))
            tables[setting] = _pivot(own, "surrogate", "surrogates")
        metric = metric[metric.notna().any(axis=1)].dropna(axis="columns", how="all")
        yield Paired(group, tables[setting], metric)


def with_sums(surrogates: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """`surrogates` with rows of class "all" added: those that are additive summed over classes.

    A sum is NaN if the surrogate is NaN for a class. Keeps placement, class, surrogate, value and
    those of detector and `axes` that are columns.
    """
    depends = _depends(surrogates, axes)
    single = surrogates[["placement", "class", *depends, "surrogate", "value"]]
    additive = [name for name, own in SURROGATES.items() if own.additive]
    total = (
        single[single["surrogate"].isin(additive)]
        .groupby(["placement", *depends, "surrogate"], dropna=False, sort=False)["value"]
        .agg(lambda values: values.sum(skipna=False))
    )
    return pd.concat([single, total.reset_index().assign(**{"class": "all"})], ignore_index=True)


def _depends(surrogates: pd.DataFrame, axes: Sequence[str]) -> list[str]:
    """What a surrogate may depend on besides placement and class."""
    return [key for key in ("detector", *axes) if key in surrogates.columns]


def matching(surrogates: pd.DataFrame, setting: Mapping[str, object]) -> pd.DataFrame:
    """Rows with the values of `setting` in columns that are there; a missing value matches any."""
    for axis, value in setting.items():
        if axis in surrogates.columns:
            of = surrogates[axis]
            surrogates = surrogates[(of == value) | of.isna()]
    return surrogates


def _pivot(table: pd.DataFrame, columns: str, source: str) -> pd.DataFrame:
    """Placements as rows, `columns` as columns, in order of appearance."""
    twice = table.duplicated(["placement", columns])
    if twice.any():
        row = table[twice].iloc[0]
        what = ", ".join(f"{name}={row[name]}" for name in ("placement", "class", columns))
        fix = "name the axis that separates them in `axes`"
        raise InputError(f"duplicate rows ({what})", place=source, fix=fix)
    placement, placements = pd.factorize(table["placement"])
    name, names = pd.factorize(table[columns])
    wide = np.full((len(placements), len(names)), np.nan)
    wide[placement, name] = table["value"]
    return pd.DataFrame(wide, placements, names)

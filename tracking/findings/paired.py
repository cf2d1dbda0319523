"""Pairs of surrogates and metrics of the same placements."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.files.columns import check_columns
from lidarplace.pog.surrogates.table import SURROGATES


@dataclass(frozen=True)
class Paired:
    """Surrogates and one metric of one group, which has a value of each of `group_columns`.

    `surrogates` have a row a placement, may have other placements than `metric`, and missing
    values; `metric` has a row a placement and a column a seed, and a number in every row."""

    group: dict[str, object]
    surrogates: pd.DataFrame
    metric: pd.DataFrame

    def by_placements(self) -> list[tuple[list[object], list[str]]]:
        """List placements with the metric and a surrogate, and all surrogates of these."""
        placements = self.metric.index
        is_known = self.surrogates.reindex(placements).notna().to_numpy()
        alike: dict[bytes, list[int]] = {}
        for i, column in enumerate(is_known.T):
            alike.setdefault(column.tobytes(), []).append(i)
        return [
            (
                placements[is_known[:, same[0]]].tolist(),
                [str(self.surrogates.columns[i]) for i in same],
            )
            for same in alike.values()
        ]


def group_columns(axes: Sequence[str]) -> list[str]:
    """Name the columns of `results` within which placements are compared."""
    return ["class", "detector", *axes, "metric", "iou", "difficulty"]


def paired(
    results: pd.DataFrame, surrogates: pd.DataFrame, axes: Sequence[str] = ()
) -> Iterator[Paired]:
    """Yield every group of `results` with its surrogates, sorted by `group_columns`.

    Results of class "all" (recall over all objects) meet the surrogates `with_sums`. A missing
    value in a column of detector or axes of `surrogates` stands for any value; `axes` are columns
    of `results`. Raises ValueError: a column is missing, or a row occurs twice."""
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
            of_setting = matching(predictors, dict(zip(("class", *depends), setting, strict=True)))
            tables[setting] = _pivot(of_setting, "surrogate", "surrogates")
        metric = metric[metric.notna().any(axis=1)].dropna(axis="columns", how="all")
        yield Paired(group, tables[setting], metric)


def with_sums(surrogates: pd.DataFrame, axes: Sequence[str] = ()) -> pd.DataFrame:
    """Add rows of class "all" to `surrogates`: those that are additive, summed over classes.

    Means over objects stay such: they are averaged over the classes that have them. Either is NaN
    if the surrogate is NaN for a class. Keeps placement, class, surrogate, value and
    those of detector and `axes` that are columns."""
    depends = _depends(surrogates, axes)
    single = surrogates[["placement", "class", *depends, "surrogate", "value"]]
    additive = [name for name, definition in SURROGATES.items() if definition.additive]
    averaged = [name for name in additive if SURROGATES[name].of_objects]
    of_all = (
        single[single["surrogate"].isin(additive)]
        .groupby(["placement", *depends, "surrogate"], dropna=False, sort=False)["value"]
        .agg(value=lambda values: values.sum(skipna=False), classes="size")
        .reset_index()
        .assign(**{"class": "all"})
    )
    of_all["value"] /= of_all.pop("classes").where(of_all["surrogate"].isin(averaged), 1)
    return pd.concat([single, of_all], ignore_index=True)


def _depends(surrogates: pd.DataFrame, axes: Sequence[str]) -> list[str]:
    """Name the columns that a surrogate may depend on besides placement and class."""
    return [key for key in ("detector", *axes) if key in surrogates.columns]


def matching(surrogates: pd.DataFrame, setting: Mapping[str, object]) -> pd.DataFrame:
    """Select rows with the values of `setting` in existing columns; a missing value matches any."""
    for axis, value in setting.items():
        if axis in surrogates.columns:
            of = surrogates[axis]
            surrogates = surrogates[(of == value) | of.isna()]
    return surrogates


def _pivot(table: pd.DataFrame, columns: str, source: str) -> pd.DataFrame:
    """Pivot to placements as rows and `columns` as columns, in order of appearance."""
    twice = table.duplicated(["placement", columns])
    if twice.any():
        row = table[twice].iloc[0]
        row_key = ", ".join(f"{name}={row[name]}" for name in ("placement", "class", columns))
        fix = "name the axis that separates them in `axes`"
        raise InputError(f"duplicate rows ({row_key})", place=source, fix=fix)
    placement, placements = pd.factorize(table["placement"])
    name, names = pd.factorize(table[columns])
    wide = np.full((len(placements), len(names)), np.nan)
    wide[placement, name] = table["value"]
    return pd.DataFrame(wide, placements, names)

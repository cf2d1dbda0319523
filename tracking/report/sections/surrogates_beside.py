"""Surrogates of the same placements beside each other: in other traffic, in other sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from tracking.labels import in_order, surrogate_label
from tracking.numbers import number
from tracking.pages.tables import MOST_ROWS, Table


def surrogates_beside(
    columns: Mapping[str, pd.DataFrame],
    surrogates: Iterable[str],
    placements: Sequence[str],
    caption: str,
    name: str,
    unit: str = "",
) -> Table:
    """A row a surrogate and placement, a column for each of `columns`.

    Args:
        columns: by head, placements as rows, surrogates as columns (`surrogates_of`).
        surrogates: those that are shown.
        placements: in the order of the rows.
        name: of the CSV file.
        unit: follows the heads there.
    """
    rows, data = [], []
    for surrogate in in_order(surrogates):
        for placement in placements:
            values = [
                float(table[surrogate].get(placement, np.nan)) if surrogate in table else np.nan
                for table in columns.values()
            ]
            rows.append((surrogate_label(surrogate), placement, *map(number, values)))
            data.append((surrogate, placement, *values))
    keys = ("surrogate", "placement")
    return Table(
        caption,
        (*keys, *columns),
        tuple(rows),
        words=frozenset({0, 1}),
        name=name,
        data=pd.DataFrame(data, columns=[*keys, *(f"{head}{unit}" for head in columns)]),
    ).first(MOST_ROWS)

"""Columns that a table must have, and what must be in them; errors name file, row and value."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray


def check_columns(found: Sequence[str], names: Sequence[str], source: str) -> None:
    """Raise ValueError that says which of `names` are not in `found`."""
    missing = [name for name in names if name not in found]
    if missing:
        raise ValueError(f"{source}: no column {', '.join(missing)}; found {', '.join(found)}")


def numbers(table: pd.DataFrame, names: Sequence[str], source: str) -> NDArray[np.float64]:
    """Columns of finite numbers; (rows, columns), float64.

    Raises:
        ValueError: a value is something else.
    """
    columns = table[list(names)].apply(pd.to_numeric, errors="coerce")
    values = columns.to_numpy(np.float64, na_value=np.nan).reshape(len(table), len(names))
    bad = ~np.isfinite(values)
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        raise ValueError(
            f"{source}: row {row}: {names[column]} must be a finite number, "
            f"found {table[names[column]].iloc[row]}"
        )
    return values


def sizes(table: pd.DataFrame, names: Sequence[str], source: str) -> NDArray[np.float64]:
    """Columns of finite numbers >= 0; (rows, columns), float64.

    Raises:
        ValueError: a value is something else.
    """
    values = numbers(table, names, source)
    if (values < 0).any():
        row, column = np.argwhere(values < 0)[0].tolist()
        raise ValueError(
            f"{source}: row {row}: {names[column]} must be at least 0, found {values[row, column]}"
        )
    return values


def integers(table: pd.DataFrame, name: str, source: str) -> NDArray[np.int64]:
    """A column of whole numbers; (rows,), int64.

    Raises:
        ValueError: a value is something else.
    """
    values = pd.to_numeric(table[name], errors="coerce")
    bad = (values.isna() | (values % 1 != 0)).to_numpy(bool)
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(
            f"{source}: row {row}: {name} must be a whole number, found {table[name].iloc[row]}"
        )
    return values.to_numpy(np.int64)

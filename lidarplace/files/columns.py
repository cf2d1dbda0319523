"""Columns of tables, validated: an error is an InputError of file, row and value."""

import math
import re
import reprlib
from collections.abc import Callable, Collection, Sequence
from decimal import Decimal
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.ranges import FRAME

_INT64 = 2.0**63
_DATE = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:|$)")  # ISO 8601
_LONGEST = 300  # characters of what was found


def check_columns(columns: Sequence[str], names: Sequence[str], source: str, fix: str = "") -> None:
    """Raise InputError that says which of `names` are not among `columns`, or twice.

    `fix` is what to do about a missing one."""
    if missing := [name for name in names if name not in columns]:
        listed = ", ".join(map(str, columns)) or "none"
        if len(listed) > _LONGEST:
            listed = f"{listed[:_LONGEST]} …"
        key = ", ".join(missing)
        raise InputError("missing column", place=source, key=key, found=listed, fix=fix)
    if twice := [name for name in names if columns.count(name) > 1]:
        raise InputError("duplicate column", place=source, key=twice[0])


def numbers(table: pd.DataFrame, names: Sequence[str], source: str) -> NDArray[np.float64]:
    """Return columns of finite numbers; (rows, columns), float64."""
    values = _floats(table, names)
    check_values(table, names, ~np.isfinite(values), "a finite number", source)
    return values


def numbers_if_known(table: pd.DataFrame, name: str, source: str) -> NDArray[np.float64]:
    """Return a column of finite numbers, NaN where they are missing; (rows,), float64."""
    values = _floats(table, [name])[:, 0]
    bad = ~np.isfinite(values) & table[name].notna().to_numpy(bool)
    check_values(table, [name], bad, "a finite number, or missing", source)
    return values


def counts_if_known(table: pd.DataFrame, name: str, source: str) -> NDArray[np.float64]:
    """Return a column of numbers >= 0, NaN where they are missing; (rows,), float64."""
    values = numbers_if_known(table, name, source)
    check_values(table, [name], values < 0, "at least 0, or missing", source)
    return values


def no_text(table: pd.DataFrame, names: Sequence[str], source: str) -> None:
    """Raise InputError for text in columns of numbers; for files whose columns have types."""
    for name in names:
        if table[name].dtype.kind not in "iufbcmM":
            text = table[name].astype(object).map(lambda value: isinstance(value, str | bytes))
            check_values(table, [name], text.to_numpy(bool), "a number", source, reprlib.repr)


def sizes(table: pd.DataFrame, names: Sequence[str], source: str) -> NDArray[np.float64]:
    """Return columns of finite numbers >= 0; (rows, columns), float64."""
    values = numbers(table, names, source)
    check_values(table, names, values < 0, "at least 0", source)
    return values


def integers(table: pd.DataFrame, name: str, source: str) -> NDArray[np.int64]:
    """Return a column of whole numbers of 64 bits; (rows,), int64."""
    values = _numeric(table[name])
    good = values.notna() & (values % 1 == 0)
    if values.dtype.kind != "i":
        good &= (values >= -_INT64) & (values < _INT64)
    check_values(table, [name], ~good.fillna(False).to_numpy(bool), "a whole number", source)
    return values.to_numpy(np.int64)


def frame_numbers(table: pd.DataFrame, source: str) -> NDArray[np.int64]:
    """Return the column `frame`: whole numbers of the range `FRAME`; (rows,), int64."""
    values = integers(table, "frame", source)
    bad = (values > FRAME.high) | (values < FRAME.low)
    check_values(table, ["frame"], bad, f"a whole number up to ±{FRAME.high}", source)
    return values


def texts(table: pd.DataFrame, name: str, source: str) -> NDArray[np.object_]:
    """Return a column of text, where names that are whole numbers are text too; (rows,), str."""
    column = table[name].astype(object)
    if (missing := column.isna().to_numpy(bool)).any():
        place = f"{source}: {row_name(table, int(np.argmax(missing)))}"
        raise InputError("missing value", place=place, key=name)
    if pd.api.types.infer_dtype(column) not in ("string", "empty"):
        good = column.map(lambda value: isinstance(value, str | int | np.integer))
        check_values(table, [name], ~good.to_numpy(bool), "text", source)
        column = column.map(str)
    return column.to_numpy(object)


def groups(table: pd.DataFrame, name: str, source: str) -> NDArray[Any]:
    """Return a column that names groups, by whole numbers or by text; (rows,)."""
    of_numbers = table[name].dtype.kind in "iuf"
    return integers(table, name, source) if of_numbers else texts(table, name, source)


def one_of(table: pd.DataFrame, name: str, allowed: Collection[str], source: str) -> None:
    """Raise InputError that names the first row whose value is none of those allowed."""
    values = table[name].astype(object)
    good = values.map(lambda value: isinstance(value, str) and value in allowed)
    check_values(table, [name], ~good.to_numpy(bool), " or ".join(allowed), source, reprlib.repr)


def _floats(table: pd.DataFrame, names: Sequence[str]) -> NDArray[np.float64]:
    """Return columns as numbers, NaN where a value is none; (rows, columns)."""
    values = [_numeric(table[name]).to_numpy(np.float64, na_value=np.nan) for name in names]
    return np.reshape(values, (len(names), len(table))).T.copy()


def _numeric(column: pd.Series) -> pd.Series:
    """Return the column as numbers, missing where a value is none, such as a date."""
    kind = column.dtype.kind
    if kind in "iuf":
        return column.astype(np.float64) if column.dtype == np.float16 else column
    if kind in "bcmM" or isinstance(column.dtype, pd.PeriodDtype):
        return pd.Series(np.nan, index=column.index)
    return pd.to_numeric(column.astype(object).map(_number), errors="coerce")


def _number(value: Any) -> Any:
    """Return the value if it may be a number, else NaN."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, _NUMBERS):
        return math.nan
    return float(value) if isinstance(value, Decimal) else value


_NUMBERS = (str, int, float, Decimal, np.integer, np.floating)


def row_name(table: pd.DataFrame, row: int) -> str:
    """Return the label of a row for messages: `row 7`, or a text, as of a row of several files."""
    label = table.index[row]
    return label if isinstance(label, str) else f"row {label}"


def check_values(
    table: pd.DataFrame,
    names: Sequence[str],
    bad: ArrayLike,
    expected: str,
    source: str,
    text: Callable[[str], str] = str,
) -> None:
    """Raise InputError for the first value that is `bad`, (rows,) or (rows, names)."""
    if np.any(bad):
        row, column = np.argwhere(np.reshape(bad, (len(table), -1)))[0].tolist()
        key, place = names[column], f"{source}: {row_name(table, row)}"
        value = table[key].iloc[row]
        shortened = (text(value) if isinstance(value, str) else str(value))[:_LONGEST]
        parts = {"expected": expected, "found": shortened}
        if "number" in expected and _DATE.match(shortened):
            parts["fix"] = "make dates numbers, such as seconds since 1970"
        raise InputError("invalid value", place=place, key=key, **parts)

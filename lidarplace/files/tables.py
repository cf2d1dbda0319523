"""Tables from files, where what is wrong with one is a line that names it, and CSV to files."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import feather

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import reading, replacing
from lidarplace.files.columns import check_columns
from lidarplace.files.regular import regular

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def read_parquet(path: Path, frames: Sequence[int] | None = None) -> pd.DataFrame:
    """Read the table in a Parquet file, or its rows of these frames.

    Other rows are never all in memory. Raises ValueError: the file cannot be read, or has another
    format."""
    # Whatever type the column has: numbers stored as text are checked later.
    rows = None if frames is None else pc.field("frame").cast("int64").isin(frames)
    # Of pandas: what it notes of a table in the file is JSON, and can be damaged as well.
    with (
        reading(path, "a Parquet file", pa.ArrowException, ValueError, KeyError),
        regular(path).open("rb") as file,  # pandas would take a path such as http:/… for an address
    ):
        return pd.read_parquet(file, filters=rows)


def read_csv(path: Path, **options: Any) -> pd.DataFrame:
    """Read the table in a CSV file; `options` are of `pandas.read_csv`.

    Commas, semicolons or tabs separate columns, whichever the first line has most of. With the last
    two a number may have a decimal comma. Raises ValueError: it cannot be read, or is not a
    table."""
    # ValueError has the subclasses ParserError and EmptyDataError.
    with reading(path, "a CSV file", ValueError), regular(path).open("rb") as file:
        head = re.sub(rb'"[^"]*"', b"", file.readline()).decode("latin-1")
        options["sep"] = max(",;\t", key=head.count)
        file.seek(0)
        table: pd.DataFrame = pd.read_csv(file, **options)
        if options["sep"] != "," and _has_decimal_commas(table):
            file.seek(0)
            table = pd.read_csv(file, decimal=",", **options)
    if not isinstance(table.index, pd.RangeIndex):
        raise InputError("more fields than the first line has names", place=f"{path}: line 2")
    if table.shape[1] == 1 and (other := re.search(r"\w *([|:/ ]) *\w", head)):
        expected = "columns separated by commas, semicolons or tabs"
        raise InputError("not a CSV file", place=path, expected=expected, found=repr(other[1]))
    return table


def _has_decimal_commas(table: pd.DataFrame) -> bool:
    texts = (table[name].astype(str) for name in table.select_dtypes(exclude="number"))
    return any(values.str.fullmatch(r"[-+]?\d+,\d+").any() for values in texts)


def write_csv(table: pd.DataFrame, path: Path) -> None:
    """Write `table` without its index, see `replacing`.

    Texts, heads included, that a spreadsheet would take for formulas have an apostrophe in front,
    with which spreadsheets mark texts. Numbers are as they are."""
    escaped = table.rename(columns=_as_text)
    for i, kind in enumerate(table.dtypes):
        if not pd.api.types.is_numeric_dtype(kind):
            escaped.isetitem(i, escaped.iloc[:, i].astype(object).map(_as_text).to_numpy())
    with replacing(path) as partial:
        escaped.to_csv(partial, index=False)


def _as_text(cell: object) -> object:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA) else cell


def read_feather(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> pd.DataFrame:
    """Read columns of the table in a Feather file, and those of `optional` that it has.

    Raises ValueError: the file cannot be read, has another format, or lacks a column."""
    with reading(path, "a Feather file", pa.ArrowException), regular(path).open("rb") as file:
        table = feather.read_table(file)
        check_columns(table.column_names, columns, str(path))
        selected = [*columns, *(name for name in optional if name in table.column_names)]
        return pd.DataFrame(table.select(selected).to_pandas(ignore_metadata=True))

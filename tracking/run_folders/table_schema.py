"""Contract of a table of a run folder: the writer and the reader go by the same columns."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.configuration.renamed_keys import current_key
from lidarplace.files.atomic import replacing
from lidarplace.files.columns import check_columns, integers, numbers_if_known
from lidarplace.files.regular import is_there
from lidarplace.files.tables import read_parquet

DType = Literal["int64", "float64", "str", "bool"]
Cell = int | float | str
"""Value of a cell of an axis."""

_WANTED = {"int64": "numbers", "float64": "numbers", "str": "text", "bool": "true and false"}


def cell(value: object) -> Cell:
    """Convert a value of the configuration to the cell of a table; a list or mapping to JSON."""
    return value if isinstance(value, (int, float, str)) else json.dumps(value)


@dataclass(frozen=True)
class Column:
    """Column of a table; values may be missing."""

    name: str
    # as it is written; a reader accepts any numbers for numbers; None: anything
    dtype: DType | None
    doc: str  # what it holds, with its unit
    needed: bool = True  # a table without it is refused
    # fills a missing column, and missing values of text; None: nothing
    unknown: float | str | bool | None = None
    # whether infinity is refused; a loss may be infinite, and the distance of one LiDAR
    finite: bool = False

    def check(self, column: pd.Series, file: Path) -> None:
        """Raise ValueError that names file, column and a value unless its kind is that of dtype."""
        values = column.dropna()
        if not len(values) or self.dtype is None:
            return
        wanted = _WANTED[self.dtype]
        good = {
            "numbers": values.dtype.kind in "iuf",
            "true and false": values.dtype.kind == "b",
            "text": pd.api.types.infer_dtype(values) in ("string", "categorical"),
        }
        if not good[wanted]:
            kind = f"{values.dtype}, such as {reprlib.repr(values.iloc[0])}"
            raise InputError(place=file, key=self.name, expected=wanted, found=kind)
        if self.dtype == "int64":
            integers(column.fillna(0).to_frame(), self.name, str(file))
        if self.finite:
            numbers_if_known(column.to_frame(), self.name, str(file))

    def plain(self, column: pd.Series) -> pd.Series:
        """Convert numbers to NumPy types.

        Whole numbers become int64 unless some are missing; numbers that are not of a NumPy type,
        or all missing, floats; others stay as they are."""
        if self.dtype is None or _WANTED[self.dtype] != "numbers":
            return column
        if self.dtype == "int64" and column.notna().all():
            return column.astype(np.int64)
        if isinstance(column.dtype, np.dtype) and column.dtype.kind in "iuf":
            return column
        if not column.notna().any():
            return pd.Series(np.nan, index=column.index)
        return column.astype(np.float64)


@dataclass(frozen=True)
class TableSchema:
    """Parquet file of a run folder; further columns are ignored."""

    name: str  # of the file, without `.parquet`
    doc: str  # what a row is
    columns: tuple[Column, ...]
    needed: bool = False  # a run folder without it is none
    # axes of the grid below these keys of the configuration are columns too; "": all
    axes: tuple[str, ...] = ()
    # columns that, with the axes, distinguish the rows; (): nothing has to
    key: tuple[str, ...] = ()

    @classmethod
    def of(cls, name: str, doc: str, *columns: Column, **further: Any) -> TableSchema:
        """Make a table of these columns; `further` are attributes."""
        return cls(name, doc, columns, **further)

    @property
    def file(self) -> str:
        """Name of the file."""
        return f"{self.name}.parquet"

    @property
    def _needed(self) -> list[str]:
        return [column.name for column in self.columns if column.needed]

    def axes_of(self, axes: Iterable[str]) -> list[str]:
        """Select the axes of a grid that are columns of this table."""
        return [a for a in axes if "" in self.axes or a.partition(".")[0] in self.axes]

    def write(self, table: pd.DataFrame, folder: Path) -> None:
        """Write in one step; without rows no columns are needed. Raises ValueError as `read`."""
        self._check(table, folder / self.file)
        with replacing(folder / self.file) as partial:
            table.to_parquet(partial, index=False)

    def read(self, folder: Path, axes: Iterable[str] = ()) -> pd.DataFrame:
        """Read the table in `folder`; without rows it gets the needed columns and the `axes`.

        Raises ValueError: the file is not a table, lacks a needed column, has one of a wrong
        kind, or duplicate rows."""
        table = read_parquet(folder / self.file).rename(columns=current_key)
        self._check(table, folder / self.file)
        self._check_key(table, axes, folder / self.file)
        if table.shape == (0, 0):
            table = table.reindex(columns=[*self._needed, *self.axes_of(axes)])
        for column in self.columns:
            if column.name in table:
                table[column.name] = column.plain(table[column.name])
            if column.unknown is None:
                continue
            if column.name not in table:
                table[column.name] = column.unknown
            elif isinstance(column.unknown, str):
                table[column.name] = table[column.name].astype(object).fillna(column.unknown)
        return table

    def read_if_there(self, folder: Path, axes: Iterable[str] = ()) -> pd.DataFrame | None:
        """Read the table as `read`; None if the file is missing."""
        return self.read(folder, axes) if is_there(folder / self.file) else None

    def _check(self, table: pd.DataFrame, file: Path) -> None:
        if table.shape == (0, 0):
            return
        if not table.columns.is_unique:
            twice = table.columns[table.columns.duplicated()][0]
            raise InputError("duplicate column", place=file, key=twice)
        check_columns(list(table.columns), self._needed, str(file))
        for column in self.columns:
            if column.name in table:
                column.check(table[column.name], file)

    def _check_key(self, table: pd.DataFrame, axes: Iterable[str], file: Path) -> None:
        """Refuse two rows that only one can be right of."""
        if not self.key or table.empty:
            return
        columns = [
            name for name in dict.fromkeys((*self.key, *self.axes_of(axes))) if name in table
        ]
        mixed = [
            name for name in columns if table[name].dtype == object
        ]  # an axis may hold anything
        keys = table[columns].astype(dict.fromkeys(mixed, "str"))
        again = keys.duplicated().to_numpy()
        if again.any():
            row, texts = int(again.argmax()), keys.astype(str)
            first = int((texts == texts.iloc[row]).all(axis=1).to_numpy().argmax())
            row_key = ", ".join(f"{name}={value}" for name, value in texts.iloc[row].items())
            raise InputError(f"duplicate rows {first} and {row} ({row_key})", place=file)

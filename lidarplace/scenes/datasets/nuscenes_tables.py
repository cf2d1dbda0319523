"""One table of a nuScenes database: a JSON file of rows with tokens that point at other tables."""

import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.json_file import read_json
from lidarplace.logs.boxes import first

TEXT = re.compile(r"(\w+_)?token|name|channel|modality|filename")
"""Names of columns of text, in all tables."""


@dataclass(frozen=True)
class TokenTable:
    """Some columns of a table in a file."""

    path: Path
    columns: Mapping[str, Sequence[Any]]  # values, all of one length; `token` names the row

    def __len__(self) -> int:
        return len(self.columns["token"])

    def row(self, index: int) -> str:
        """Return file and token of a row, for messages."""
        return f"{self.path}: token {self.columns['token'][index]}"

    def numbers(self, name: str, *shape: int) -> NDArray[np.float64]:
        """Return a column of finite numbers, or of lists of so many: (rows, *shape).

        Raises ValueError."""
        values = self.columns[name]
        if not values:
            return np.empty((0, *shape))
        array = _floats(values, (len(values), *shape))
        wanted = f"{shape[0]} finite numbers" if shape else "a finite number"
        if array is None:
            self.check(name, lambda value: _floats(value, shape) is not None, wanted)
        assert array is not None
        return array

    def check(self, name: str, good: Callable[[Any], bool], wanted: str) -> None:
        """Raise ValueError that names the first row whose value is not `good`."""
        for index, value in enumerate(self.columns[name]):
            if not good(value):
                where = f"{self.path}: row {index}" if name == "token" else self.row(index)
                raise InputError(place=where, key=name, expected=wanted, found=reprlib.repr(value))

    def rows_in(self, other: "TokenTable", name: str) -> NDArray[np.int64]:
        """Return the rows of `other` that the tokens in column `name` point at; (rows,), int64.

        Raises ValueError if `other` lacks a row, or has two for a token."""
        index = pd.Index(other.columns["token"], dtype=object)
        if (twice := first(index.duplicated())) is not None:
            raise InputError("duplicate token", place=other.row(twice))
        rows = index.get_indexer(pd.Index(self.columns[name], dtype=object))
        if (row := first(rows < 0)) is not None:
            problem, token = f"not in {other.path.name}", repr(self.columns[name][row])
            raise InputError(problem, place=self.row(row), key=name, found=token)
        return np.asarray(rows, np.int64)

    def take(self, rows: NDArray[np.int64]) -> "TokenTable":
        """Return the rows with these numbers."""
        taken = {name: [column[i] for i in rows] for name, column in self.columns.items()}
        return TokenTable(self.path, taken)


def _floats(value: Any, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    array = np.array(value, object)
    if bool in set(map(type, array.ravel().tolist())):
        return None
    try:
        numbers = array.astype(np.float64)
    except (TypeError, ValueError):
        return None
    return numbers if numbers.shape == shape and np.isfinite(numbers).all() else None


def read_table(path: Path, names: Sequence[str]) -> TokenTable:
    """Read columns `token` and `names` of a table.

    Raises ValueError if the file is missing, or not a JSON list of objects with these columns."""
    names = ("token", *names)
    # Rows become tuples while they are read: all columns as dicts would take half as much again.
    try:
        rows = read_json(path, itemgetter(*names))
    except KeyError as error:  # of the getter; the file is read once more to say where
        raise _lack_of(error.args[0], path) from None
    if not isinstance(rows, list) or not all(isinstance(row, tuple) for row in rows):
        raise InputError(place=path, expected="a JSON list of objects")
    table = TokenTable(path, {name: [row[i] for row in rows] for i, name in enumerate(names)})
    for name in names:
        if TEXT.fullmatch(name):
            table.check(name, lambda value: isinstance(value, str), "text")
    return table


def _lack_of(name: str, path: Path) -> InputError:
    rows = read_json(path)
    for number, row in enumerate(rows if isinstance(rows, list) else ()):
        place = f"{path}: row {number}"
        if isinstance(row, dict) and name not in row:
            keys = reprlib.repr(list(row))
            return InputError("missing column", place=place, key=name, found=keys)
        for key, value in row.items() if isinstance(row, dict) else ():
            if isinstance(value, dict):
                text = reprlib.repr(value)
                return InputError(place=place, key=key, expected="no object", found=text)
    return InputError(place=path, expected="a JSON list of objects")

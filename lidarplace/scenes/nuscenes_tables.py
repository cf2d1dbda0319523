"""One table of a nuScenes database: a JSON file of rows with tokens that point at other tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray


@dataclass(frozen=True)
class Table:
    """Some columns of a table.

    Attributes:
        path: the file.
        columns: values by column, all of one length; `token` names the row.
    """

    path: Path
    columns: Mapping[str, Sequence[Any]]

    def __len__(self) -> int:
        return len(self.columns["token"])

    def row(self, index: int) -> str:
        """File and token of a row, for messages."""
        return f"{self.path}: token {self.columns['token'][index]}"

    def numbers(self, name: str, *shape: int) -> NDArray[np.float64]:
        """A column of finite numbers, or of lists of so many: (rows, *shape), float64.

        Raises:
            ValueError: a value is something else.
        """
        values = self.columns[name]
        if not values:
            return np.empty((0, *shape))
        array = _floats(values)
        if array is not None and array.shape == (len(values), *shape) and np.isfinite(array).all():
            return array
        for index, value in enumerate(values):
            one = _floats(value)
            if one is None or one.shape != shape or not np.isfinite(one).all():
                wanted = f"{shape[0]} finite numbers" if shape else "a finite number"
                raise ValueError(f"{self.row(index)}: {name} must be {wanted}, found {value!r}")
        raise AssertionError("unreachable")

    def rows_in(self, other: Table, name: str) -> NDArray[np.int64]:
        """Which row of `other` the tokens in column `name` point at; (rows,), int64.

        Raises:
            ValueError: `other` has no such row, or two.
        """
        index = pd.Index(other.columns["token"], dtype=object)
        if not index.is_unique:
            twice = int(np.argmax(index.duplicated()))
            raise ValueError(f"{other.row(twice)}: is there twice")
        rows = index.get_indexer(pd.Index(self.columns[name], dtype=object)).astype(np.int64)
        if (rows < 0).any():
            row = int(np.argmax(rows < 0))
            raise ValueError(
                f"{self.row(row)}: {name} {self.columns[name][row]!r} is not in {other.path.name}"
            )
        return rows

    def take(self, rows: NDArray[np.int64]) -> Table:
        """The rows with these numbers."""
        chosen = rows.tolist()
        return Table(
            self.path, {name: [values[i] for i in chosen] for name, values in self.columns.items()}
        )


def _floats(value: Any) -> NDArray[np.float64] | None:
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError):
        return None


def read_table(path: Path, names: Sequence[str]) -> Table:
    """Columns `token` and `names` of a table.

    Raises:
        ValueError: there is no such file, or it is no JSON list of objects with these columns.
    """
    names = ("token", *names)
    # Rows become tuples while they are read: all columns as dicts would take half as much again.
    rows = _load(path, itemgetter(*names))
    if not isinstance(rows, list) or not all(isinstance(row, tuple) for row in rows):
        raise ValueError(f"{path}: must be a JSON list of objects")
    return Table(path, {name: [row[i] for row in rows] for i, name in enumerate(names)})


def _load(path: Path, hook: Callable[[dict[str, Any]], Any]) -> Any:
    try:
        with path.open(encoding="utf-8") as file:
            return json.load(file, object_hook=hook)
    except FileNotFoundError:
        raise ValueError(f"{path}: no such table") from None
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}: line {error.lineno}: no JSON: {error.msg}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: no JSON: byte {error.start} is not UTF-8") from None
    except KeyError as error:
        name = error.args[0]
    rows = json.loads(path.read_text(encoding="utf-8"))
    row = next(i for i, row in enumerate(rows) if name not in row)
    raise ValueError(f"{path}: row {row}: no column {name}; found {list(rows[row])}")

"""Wrong tables: cells, columns, types and rows of Parquet, CSV, Feather and pickles."""

from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pandas as pd

from tests.fuzz.nasty import TEXTS, number


def _read(path: Path) -> pd.DataFrame:
    if path.suffix == ".csv":
        return pd.read_csv(path)
    if path.suffix == ".gz":
        return pd.read_pickle(path)
    return pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_feather(path)


def _write(path: Path, table: pd.DataFrame) -> None:
    if path.suffix == ".csv":
        table.to_csv(path, index=False)
    elif path.suffix == ".gz":
        table.to_pickle(path)
    elif path.suffix == ".parquet":
        table.to_parquet(path, index=False)
    else:
        table.reset_index(drop=True).to_feather(path)


def _column(table: pd.DataFrame, random: Random) -> str:
    return random.choice(list(table.columns))


def cell(path: Path, random: Random) -> str:
    """One value of a column, of the same kind as the others."""
    table = _read(path)
    name = _column(table, random)
    row = random.randrange(len(table))
    values = table[name].tolist()
    if isinstance(values[row], str):
        values[row] = random.choice((*TEXTS, None))
        table[name] = pd.Series(values, dtype=object)
    elif isinstance(values[row], np.ndarray):
        values[row] = values[row].copy()
        values[row][random.randrange(len(values[row]))] = number(random)
        table[name] = pd.Series(values, dtype=object)
    else:
        values[row] = number(random)
        table[name] = _numbers(values)
    _write(path, table)
    return f"cell of {name}: {values[row]!r:.30}"


def _numbers(values: list[Any]) -> pd.Series:
    """Convert to integers if they fit, else to floats."""
    try:
        if all(isinstance(value, int) for value in values):
            return pd.Series(np.array(values, np.int64))
    except OverflowError:
        pass
    return pd.Series(values, dtype=float)


KINDS: dict[str, Any] = {
    "text": lambda column: column.astype(str),
    "words": lambda column: pd.Series(["banana"] * len(column)),
    "booleans": lambda column: pd.Series(np.arange(len(column)) % 2 == 0),
    "lists": lambda column: pd.Series([[1.0, 2.0]] * len(column)),
    "mappings": lambda column: pd.Series([{"a": 1}] * len(column)),
    "bytes": lambda column: pd.Series([b"\xff\x00"] * len(column)),
    "times": lambda column: pd.Series(pd.date_range("2020", periods=len(column))),
    "durations": lambda column: pd.Series(pd.to_timedelta(np.arange(len(column)), unit="s")),
    "missing": lambda column: pd.Series([None] * len(column), dtype=object),
    "nan": lambda column: pd.Series([np.nan] * len(column)),
    "infinite": lambda column: pd.Series([np.inf] * len(column)),
    "unsigned": lambda column: pd.Series(np.full(len(column), 2**64 - 1, np.uint64)),
    "nullable": lambda column: pd.Series([None] * len(column), dtype="Int64"),
    "categories": lambda column: pd.Series(column.astype(str), dtype="category"),
    "half": lambda column: pd.Series(np.zeros(len(column), np.float16)),
    "periods": lambda column: pd.Series(pd.period_range("2020", periods=len(column), freq="D")),
}


def kind(path: Path, random: Random) -> str:
    """A whole column of another type."""
    table = _read(path)
    name, into = _column(table, random), random.choice(list(KINDS))
    table[name] = KINDS[into](table[name])
    _write(path, table)
    return f"column {name} of {into}"


def dropped(path: Path, random: Random) -> str:
    table = _read(path)
    name = _column(table, random)
    _write(path, table.drop(columns=name))
    return f"no column {name}"


def renamed(path: Path, random: Random) -> str:
    table = _read(path)
    name = _column(table, random)
    _write(path, table.rename(columns={name: random.choice((name.upper(), "", name + " ", "1"))}))
    return f"column {name} renamed"


def lower_case(path: Path, random: Random) -> str:
    """Texts in lower case, as other tools write classes."""
    table = _read(path)
    texts = [name for name in table.columns if isinstance(table[name].iloc[0], str)]
    if not texts:
        return dropped(path, random)
    name = random.choice(texts)
    table[name] = table[name].str.lower()
    _write(path, table)
    return f"column {name} in lower case"


def rows(path: Path, random: Random) -> str:
    """No row, or rows twice."""
    table = _read(path)
    none = random.random() < 0.5
    _write(path, table.iloc[:0] if none else pd.concat([table, table], ignore_index=True))
    return "no rows" if none else "rows twice"


def no_columns(path: Path, random: Random) -> str:
    _write(path, pd.DataFrame(index=range(3)))
    return "no columns"


def ragged(path: Path, random: Random) -> str:
    """CSV alone: a row with more or fewer fields, an open quote, another separator."""
    if path.suffix != ".csv":
        return cell(path, random)
    lines = path.read_text().splitlines()
    row = random.randrange(len(lines))
    lines[row] = random.choice(
        (
            lines[row] + ",1,2",
            lines[row].partition(",")[0],
            '"' + lines[row],
            lines[row].replace(",", ";"),
        )
    )
    path.write_text("\n".join(lines))
    return f"line {row + 1} ragged"


ANY = (cell, cell, cell, kind, kind, dropped, renamed, lower_case, rows, no_columns, ragged)

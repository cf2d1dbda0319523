"""A label file as a table, and the columns that a mapping names in it."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from lidarplace.files.tables import read_csv, read_parquet


def read_table(path: Path, texts: Iterable[str | None] = ()) -> pd.DataFrame:
    """The table in a CSV or a Parquet file.

    Args:
        texts: columns that name something, in which `007` is no number.

    Raises:
        ValueError: the file cannot be read, or has another suffix.
    """
    if path.suffix.lower() == ".csv":
        return read_csv(path, dtype={name: str for name in texts if name is not None})
    if path.suffix.lower() == ".parquet":
        return read_parquet(path)
    raise ValueError(f"{path}: must end in .csv or .parquet")


def check_mapped(table: pd.DataFrame, names: Mapping[str, str | None], source: str) -> None:
    """Raise ValueError for a column, by key of the mapping, that the table does not have."""
    for key, name in names.items():
        if name is not None and name not in table.columns:
            listed = ", ".join(map(str, table.columns)) or "none"
            raise ValueError(f"{source}: {key}: no column {name!r}; found {listed[:300]}")

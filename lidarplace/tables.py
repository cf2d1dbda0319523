"""Tables from files; what is wrong with a file is one line that names it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
from pyarrow import feather

from lidarplace.columns import check_columns


def read_parquet(path: Path) -> pd.DataFrame:
    """The table in a Parquet file.

    Raises:
        ValueError: the file cannot be read, or is no such table.
    """
    try:
        with path.open("rb") as file:  # pandas would take a path such as http:/… for an address
            return pd.read_parquet(file)
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except OSError as error:  # of the disk, or of Arrow for a page that is damaged
        raise ValueError(f"{path}: cannot be read: {_reason(error)}") from None
    # Of pandas: what it notes of a table in the file is JSON, and can be damaged as well.
    except (pa.ArrowException, ValueError, KeyError) as error:
        raise ValueError(f"{path}: is no Parquet file: {_reason(error)}") from None


def read_csv(path: Path, **options: Any) -> pd.DataFrame:
    """The table in a CSV file; `options` are of `pandas.read_csv`.

    Raises:
        ValueError: the file cannot be read, or is no such table.
    """
    try:
        with path.open("rb") as file:
            return pd.read_csv(file, **options)
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {_reason(error)}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is no CSV file: byte {error.start} is not UTF-8") from None
    except ValueError as error:  # and its subclasses ParserError and EmptyDataError
        raise ValueError(f"{path}: is no CSV file: {_reason(error)}") from None


def read_feather(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    """These columns of the table in a Feather file.

    Raises:
        ValueError: the file cannot be read, is no such table, or lacks a column.
    """
    try:
        with path.open("rb") as file:
            table = feather.read_table(file)
        check_columns(table.column_names, columns, str(path))
        return table.select(list(columns)).to_pandas(ignore_metadata=True)
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {_reason(error)}") from None
    except pa.ArrowException as error:
        raise ValueError(f"{path}: no Feather file: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    text = getattr(error, "strerror", None) or (str(error).strip().splitlines() or [""])[0]
    return text or type(error).__name__

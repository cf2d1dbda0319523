"""A result as files in a folder: tables, arrays, weights, and all else in `result.json`."""

from __future__ import annotations

import json
import secrets
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from lidarplace.files import sync

Value = dict[str, Any]
"""A result: DataFrames, arrays, `state_dict`s of tensors and plain data, by name."""

RECORD = "result.json"

_MAPPED_BYTES = 1_000_000  # smaller arrays are not worth an open file


def write_result(folder: Path, value: Mapping[str, Any], record: Mapping[str, Any]) -> None:
    """Write a result into an empty folder and wait until it is on the disk.

    Args:
        record: plain data about the result.

    Raises:
        OSError: a file cannot be written.
        TypeError: an entry that is neither table, array, weights nor plain data.
    """
    plain = {}
    for name, item in value.items():
        if isinstance(item, pd.DataFrame):
            item.to_parquet(folder / f"{name}.parquet", index=False)
        elif isinstance(item, np.ndarray):
            np.save(folder / f"{name}.npy", item, allow_pickle=False)
        elif name.endswith("state_dict"):
            import torch  # heavy, and only trainings have weights

            # Given a path, torch would raise a RuntimeError that says nothing of the disk.
            with (folder / f"{name}.pt").open("wb") as file:
                torch.save(item, file)
        else:
            plain[name] = item
    content = {
        "record": dict(record),
        "id": secrets.token_hex(8),  # of these very files, should another process write them too
        "files": {path.name: path.stat().st_size for path in sorted(folder.iterdir())},
        "value": plain,
    }
    (folder / RECORD).write_text(json.dumps(content), encoding="utf-8")
    for path in folder.iterdir():
        sync(path)


def read_content(folder: Path) -> dict[str, Any]:
    """`result.json`: "record", "id", "files" (size in bytes by name) and "value", the plain data.

    Raises:
        FileNotFoundError: the folder is not there.
        ValueError: the file is missing or damaged.
    """
    try:
        content = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except FileNotFoundError:
        if not folder.is_dir():
            raise
        raise damaged(folder, f"{RECORD} is missing") from None
    except ValueError:
        content = None
    if not isinstance(content, dict) or content.keys() != {"record", "id", "files", "value"}:
        raise damaged(folder, f"{RECORD} is not what was written")
    return content


def check_files(folder: Path, sizes: Mapping[str, int], named: object) -> None:
    """Raises ValueError if a file is missing or has another size. Errors call the folder `named`.

    A disk that lost power or a copy that was interrupted can leave such a folder.
    """
    for name, size in sizes.items():
        try:
            found = (folder / name).stat().st_size
        except FileNotFoundError:
            raise damaged(named, f"{name} is missing") from None
        if found != size:
            raise damaged(named, f"{name} has {found} bytes, {size} were written")


def read_value(folder: Path, names: Collection[str] | None = None) -> Value:
    """Read a result, or its entries of these names. Large arrays are mapped, read-only.

    Raises:
        FileNotFoundError: the folder is not there.
        KeyError: the result has no entries of these names.
        DamagedResult: the result is not whole.
    """
    content = read_content(folder)
    check_files(folder, content["files"], folder)
    files = {Path(name).stem: folder / name for name in content["files"]}
    plain = content["value"]
    wanted = [*plain, *files] if names is None else names
    unknown = [name for name in wanted if name not in plain and name not in files]
    if unknown:
        raise KeyError(f"{folder} holds no {', '.join(unknown)}; it holds {[*plain, *files]}")
    return {name: _read(files[name]) if name in files else plain[name] for name in wanted}


class DamagedResult(ValueError):
    """A result is not whole."""


def damaged(named: object, fault: str) -> DamagedResult:
    """The error for a result that is not whole."""
    return DamagedResult(f"{named} is damaged: {fault}; remove it to compute it again")


def _read(path: Path) -> Any:
    if path.suffix == ".parquet":
        # Half the time of pandas.read_parquet, which looks for data sets of many files.
        return pq.ParquetFile(path).read(use_threads=False).to_pandas()
    if path.suffix == ".npy":
        large = path.stat().st_size > _MAPPED_BYTES
        return np.load(path, mmap_mode="r" if large else None, allow_pickle=False)
    import torch

    return torch.load(path, weights_only=True)

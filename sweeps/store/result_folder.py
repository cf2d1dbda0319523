"""A result as files in a folder: tables, arrays, weights, and all else in `result.json`."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Collection, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from lidarplace.files.atomic import sync

Value = dict[str, Any]
"""A result: DataFrames, arrays, `state_dict`s of tensors and plain data, by name."""

RECORD = "result.json"

_MAPPED_BYTES = 1_000_000  # smaller arrays are not worth an open file


def write_result(
    folder: Path, value: Mapping[str, Any], place: str, record: Mapping[str, Any]
) -> None:
    """Write a result into an empty folder and wait until it is on the disk.

    Args:
        place: "STAGE/KEY" of the result, where the folder will be.
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
            from training.checkpoints import write_tensors  # torch, and only trainings have weights

            write_tensors(folder / f"{name}.pt", item)
        else:
            plain[name] = item
    content = {
        "place": place,
        "record": dict(record),
        "id": secrets.token_hex(8),  # of these very files, should another process write them too
        "files": {
            path.name: {"bytes": path.stat().st_size, "digest": _digest(path)}
            for path in sorted(folder.iterdir())
        },
        "value": plain,
    }
    content = json.loads(json.dumps(content))  # as it will be read: keys are strings, and the like
    content["digest"] = _digest_of_content(content)
    (folder / RECORD).write_text(json.dumps(content), encoding="utf-8")
    for path in folder.iterdir():
        sync(path)


def read_content(folder: Path) -> dict[str, Any]:
    """`result.json`: "place", "record", "id", "files" ("bytes" and "digest" by name) and "value",
    the plain data.

    Raises:
        FileNotFoundError: the folder is not there.
        DamagedResult: the file is missing, damaged or of another folder's result.
    """
    try:
        data = (folder / RECORD).read_bytes()
    except FileNotFoundError:
        if not folder.is_dir():
            raise
        raise damaged(folder, f"{RECORD} is missing") from None
    return parse_content(data, f"{folder.parent.name}/{folder.name}", folder)


def parse_content(data: bytes, place: str, named: object) -> dict[str, Any]:
    """What `read_content` returns, from the bytes of the `result.json` that is at `place`.

    Args:
        named: what errors call the folder.

    Raises:
        DamagedResult: they are damaged, or of the result of another place.
    """
    try:
        content: dict[str, Any] = json.loads(data)
        whole = content.pop("digest") == _digest_of_content(content)
        found = content["place"]
    except (ValueError, AttributeError, KeyError, TypeError, RecursionError):
        whole = False
    if not whole:
        raise damaged(named, f"{RECORD} is not what was written")
    if found != place:
        raise damaged(named, f"its {RECORD} is of {found}")
    return content


def check_files(
    folder: Path, files: Mapping[str, Mapping[str, Any]], read: Iterable[str], named: object
) -> None:
    """Raise DamagedResult if a file is missing or not what was written.

    A disk that lost power or a copy that was interrupted leaves files of another size, a bad disk
    or memory files of other content.

    Args:
        files: "bytes" and "digest" of all files, by name.
        read: names of those that are read, whose content is looked at too.
        named: what errors call the folder.
    """
    for name, written in files.items():
        try:
            found = (folder / name).stat().st_size
        except FileNotFoundError:
            raise damaged(named, f"{name} is missing") from None
        if found != written["bytes"]:
            raise damaged(named, f"{name} has {found} bytes, {written['bytes']} were written")
    for name in read:
        if _digest(folder / name) != files[name]["digest"]:
            raise damaged(named, f"{name} is not what was written")


def read_value(folder: Path, names: Collection[str] | None = None) -> Value:
    """Read a result, or its entries of these names. Large arrays are mapped, read-only.

    Raises:
        FileNotFoundError: the folder is not there.
        KeyError: the result has no entries of these names.
        DamagedResult: the result is not whole.
    """
    content = read_content(folder)
    files = {Path(name).stem: name for name in content["files"]}
    plain = content["value"]
    wanted = [*plain, *files] if names is None else names
    unknown = [name for name in wanted if name not in plain and name not in files]
    if unknown:
        raise KeyError(f"{folder} holds no {', '.join(unknown)}; it holds {[*plain, *files]}")
    read = [files[name] for name in wanted if name in files]
    check_files(folder, content["files"], read, folder)
    return {name: _read(folder / files[name]) if name in files else plain[name] for name in wanted}


class DamagedResult(ValueError):
    """A result is not what was written, and counts as not there."""


def damaged(named: object, fault: str) -> DamagedResult:
    """The error for a result that is not what was written."""
    return DamagedResult(f"{named} is damaged: {fault}; it is removed, to be computed again")


def _digest(path: Path) -> str:
    """Hash of a file's content. What is mapped afterwards is in the page cache by then.

    Not one of the faster kinds from a package of its own: 1.2 GB/s is more than most disks have.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, _hash).hexdigest()


def _digest_of_content(content: Mapping[str, Any]) -> str:
    return _hash(json.dumps(content).encode()).hexdigest()


_hash = partial(hashlib.blake2b, digest_size=16)


def _read(path: Path) -> Any:
    if path.suffix == ".parquet":
        # Half the time of pandas.read_parquet, which looks for data sets of many files.
        return pq.ParquetFile(path).read(use_threads=False).to_pandas()
    if path.suffix == ".npy":
        large = path.stat().st_size > _MAPPED_BYTES
        return np.load(path, mmap_mode="r" if large else None, allow_pickle=False)
    import torch

    return torch.load(path, weights_only=True)

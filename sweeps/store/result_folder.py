"""Results as files of a folder, by the fields of their class.

Tables, arrays and weights are files, all other fields are in `result.json`."""

import hashlib
import json
import secrets
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar, cast

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from lidarplace.files.atomic import sync


class Dataclass(Protocol):
    """An instance of a dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


R = TypeVar("R", bound=Dataclass)
T = TypeVar("T")

RECORD = "result.json"

_MAPPED_BYTES = 1_000_000  # smaller arrays are not worth an open file


@dataclass(frozen=True)
class Ran:
    """The circumstances of a computation.

    Machine and process, the most bytes that the process held, whether a step had fewer frames than
    configured, as memory was too small, and the seconds before a stop."""

    node: str = ""
    pid: int = 0
    peak_memory: int = 0
    batch_size_reduced: bool = False
    earlier_seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Record(Ran):
    """The circumstances of a computation with the label of the task and its seconds."""

    label: str
    seconds: float


@dataclass(frozen=True)
class Written:
    """A file of a result: its size, and the hash of its content."""

    bytes: int
    digest: str


@dataclass(frozen=True)
class Content:
    """The content of `result.json`.

    The plain data of the result, its files by name, and an id that distinguishes these files from
    those that another process writes of the same result."""

    record: Record
    id: str
    files: Mapping[str, Written]
    value: Mapping[str, object]


def write_result(folder: Path, value: Dataclass, place: str, record: Record) -> None:
    """Write a result into an empty folder, which will be at `place`, and sync it to the disk.

    Raises OSError, and TypeError: a field is neither table, array, arrays by name, weights nor
    plain data."""
    items = {item.name: getattr(value, item.name) for item in fields(value)}
    plain = {name: item for name, item in items.items() if not _write(folder, name, item)}
    content = {
        "place": place,
        "record": asdict(record),
        "id": secrets.token_hex(8),
        "files": {
            path.name: {"bytes": path.stat().st_size, "digest": _digest(path)}
            for path in sorted(folder.iterdir())
        },
        "value": plain,
    }
    # As it will be read: keys are strings, dataclasses are mappings, and the like.
    content = json.loads(json.dumps(content, default=asdict))
    content["digest"] = _digest_of_content(content)
    (folder / RECORD).write_text(json.dumps(content), encoding="utf-8")
    for path in folder.iterdir():
        sync(path)


def _write(folder: Path, name: str, item: object) -> bool:
    """Write a field as files; False for plain data."""
    if isinstance(item, pd.DataFrame):
        item.to_parquet(folder / f"{name}.parquet", index=False)
    elif isinstance(item, np.ndarray):
        np.save(folder / f"{name}.npy", item, allow_pickle=False)
    elif name.endswith("state_dict") and isinstance(item, Mapping):
        from training.checkpoints import write_tensors  # torch, and only trainings have weights

        write_tensors(folder / f"{name}.pt", item)
    elif isinstance(item, Mapping) and any(isinstance(a, np.ndarray) for a in item.values()):
        for key, array in item.items():
            np.save(folder / f"{name}_{key}.npy", array, allow_pickle=False)
    else:
        return False
    return True


def read_content(folder: Path) -> Content:
    """Read `result.json`.

    Raises FileNotFoundError: there is no folder; DamagedResult: the file is missing, damaged or of
    the result of another folder."""
    try:
        data = (folder / RECORD).read_bytes()
    except FileNotFoundError:
        if not folder.is_dir():
            raise
        raise damaged(folder, f"{RECORD} is missing") from None
    return parse_content(data, f"{folder.parent.name}/{folder.name}", folder)


def parse_content(data: bytes, place: str, named: object) -> Content:
    """Parse the bytes of the `result.json` at `place`, which errors call `named`.

    Raises DamagedResult: they are damaged, or of the result of another place."""
    try:
        content = json.loads(data)
        whole = content.pop("digest") == _digest_of_content(content)
        written_place = content["place"]
    except (ValueError, AttributeError, KeyError, TypeError, RecursionError):
        whole = False
    if not whole:
        raise damaged(named, f"{RECORD} is not what was written")
    if written_place != place:
        raise damaged(named, f"its {RECORD} is of {written_place}")
    files = {name: Written(**written) for name, written in content["files"].items()}
    return Content(Record(**content["record"]), content["id"], files, content["value"])


def check_files(
    folder: Path, files: Mapping[str, Written], read: Iterable[str], named: object
) -> None:
    """Check the size of all files and the content of those to `read`.

    Raises DamagedResult, which calls the folder `named`: a file is missing or has another size, as
    after power loss or an interrupted copy, or another content, as on a bad disk."""
    for name, written in files.items():
        try:
            size = (folder / name).stat().st_size
        except FileNotFoundError:
            raise damaged(named, f"{name} is missing") from None
        if size != written.bytes:
            raise damaged(named, f"{name} has {size} bytes, {written.bytes} were written")
    for name in read:
        if _digest(folder / name) != files[name].digest:
            raise damaged(named, f"{name} is not what was written")


def read_result(folder: Path, kind: type[R], of: Callable[[R], T]) -> T:
    """Return `of` a result of a class, of which only the fields that it uses are read.

    Large arrays are mapped, read-only. Raises FileNotFoundError: there is no folder; KeyError: the
    result lacks a field; DamagedResult."""
    content = read_content(folder)
    check_files(folder, content.files, (), folder)
    # Not a `kind`, for which all fields would be read; to `of` it looks like one.
    return of(cast(R, _Fields(folder, content, {item.name: item for item in fields(kind)})))


def whole(kind: type[R]) -> Callable[[R], R]:
    """Return a function that reads all fields of a result, for `read_result`."""
    return lambda result: kind(**{item.name: getattr(result, item.name) for item in fields(kind)})


class _Fields:
    """The fields of a result, each of which is read when it is used."""

    def __init__(self, folder: Path, content: Content, items: Mapping[str, Field[Any]]) -> None:
        self._folder, self._content, self._items = folder, content, items

    def __getattr__(self, name: str) -> object:
        item, plain = self._items[name], self._content.value
        if name in plain:
            # A field of a class such as Roi has the fields of that class.
            return item.type(**plain[name]) if is_dataclass(item.type) else plain[name]  # type: ignore
        stems = {Path(file).stem: file for file in self._content.files}
        if name in stems:
            return self._read(stems[name])
        by_key = {k: file for k, file in stems.items() if k.startswith(f"{name}_")}
        if by_key:
            return {k.removeprefix(f"{name}_"): self._read(file) for k, file in by_key.items()}
        if item.default is MISSING and item.default_factory is MISSING:
            raise KeyError(f"{self._folder} holds no {name}; it holds {[*plain, *stems]}")
        return item.default if item.default_factory is MISSING else item.default_factory()

    def _read(self, file: str) -> object:
        check_files(self._folder, self._content.files, [file], self._folder)
        return _read(self._folder / file)


class DamagedResult(ValueError):
    """A result is not what was written, and counts as missing."""


def damaged(named: object, fault: str) -> DamagedResult:
    """Return the error for a result that has a fault."""
    return DamagedResult(f"{named} is damaged: {fault}; it is removed, to be computed again")


def _digest(path: Path) -> str:
    """Hash the content of a file, which is in the page cache when it is mapped afterwards.

    1.2 GB/s is more than most disks have, so no package with a faster hash is needed."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, _hash).hexdigest()


def _digest_of_content(content: Mapping[str, object]) -> str:
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

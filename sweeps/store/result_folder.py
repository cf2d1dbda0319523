"""A result as files in a folder, by the fields of its class: tables, arrays, weights, and all else
in `result.json`."""

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
    """How a result was computed: where, the most bytes that the process held, whether a step had
    fewer frames than asked for, for want of memory, and the seconds before a stop."""

    node: str = ""
    pid: int = 0
    peak_memory: int = 0
    batch_size_reduced: bool = False
    earlier_seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Record(Ran):
    """Further what the task is called, and the seconds that it took."""

    label: str
    seconds: float


@dataclass(frozen=True)
class Written:
    """A file of a result: its size, and the hash of its content."""

    bytes: int
    digest: str


@dataclass(frozen=True)
class Content:
    """What `result.json` says: the plain data of the result, its files, by name, and an id of these
    very files, should another process write them too."""

    record: Record
    id: str
    files: Mapping[str, Written]
    value: Mapping[str, object]


def write_result(folder: Path, value: Dataclass, place: str, record: Record) -> None:
    """Write a result into an empty folder, which will be at `place`, and wait until it is on the
    disk. Raises OSError, and TypeError: a field that is neither table, array, arrays by name,
    weights nor plain data."""
    plain = {}
    for name, item in ((own.name, getattr(value, own.name)) for own in fields(value)):
        if isinstance(item, pd.DataFrame):
            item.to_parquet(folder / f"{name}.parquet", index=False)
        elif isinstance(item, np.ndarray):
            np.save(folder / f"{name}.npy", item, allow_pickle=False)
        elif name.endswith("state_dict") and item is not None:
            from training.checkpoints import write_tensors  # torch, and only trainings have weights

            write_tensors(folder / f"{name}.pt", item)
        elif isinstance(item, Mapping) and any(isinstance(a, np.ndarray) for a in item.values()):
            for key, array in item.items():
                np.save(folder / f"{name}_{key}.npy", array, allow_pickle=False)
        else:
            plain[name] = item
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


def read_content(folder: Path) -> Content:
    """What `result.json` says. Raises FileNotFoundError: the folder is not there; DamagedResult:
    the file is missing, damaged or of another folder's result."""
    try:
        data = (folder / RECORD).read_bytes()
    except FileNotFoundError:
        if not folder.is_dir():
            raise
        raise damaged(folder, f"{RECORD} is missing") from None
    return parse_content(data, f"{folder.parent.name}/{folder.name}", folder)


def parse_content(data: bytes, place: str, named: object) -> Content:
    """What `read_content` returns, from the bytes of the `result.json` that is at `place`, which
    errors call `named`. Raises DamagedResult: they are damaged, or of the result of another place.
    """
    try:
        content = json.loads(data)
        whole = content.pop("digest") == _digest_of_content(content)
        found = content["place"]
    except (ValueError, AttributeError, KeyError, TypeError, RecursionError):
        whole = False
    if not whole:
        raise damaged(named, f"{RECORD} is not what was written")
    if found != place:
        raise damaged(named, f"its {RECORD} is of {found}")
    files = {name: Written(**written) for name, written in content["files"].items()}
    return Content(Record(**content["record"]), content["id"], files, content["value"])


def check_files(
    folder: Path, files: Mapping[str, Written], read: Iterable[str], named: object
) -> None:
    """Raise DamagedResult, which calls the folder `named`, if a file is missing or has another
    size, as after power loss or an interrupted copy, or one of those to read another content, as on
    a bad disk."""
    for name, written in files.items():
        try:
            found = (folder / name).stat().st_size
        except FileNotFoundError:
            raise damaged(named, f"{name} is missing") from None
        if found != written.bytes:
            raise damaged(named, f"{name} has {found} bytes, {written.bytes} were written")
    for name in read:
        if _digest(folder / name) != files[name].digest:
            raise damaged(named, f"{name} is not what was written")


def read_result(folder: Path, kind: type[R], of: Callable[[R], T]) -> T:
    """What `of` takes from a result of a class, of which no other fields are read. Large arrays are
    mapped, read-only. Raises FileNotFoundError: the folder is not there; KeyError: the result lacks
    a field; DamagedResult."""
    content = read_content(folder)
    check_files(folder, content.files, (), folder)
    # Not a `kind`, for which all fields would be read; to `of` it looks like one.
    return of(cast(R, _Fields(folder, content, {own.name: own for own in fields(kind)})))


def whole(kind: type[R]) -> Callable[[R], R]:
    """Takes all fields from a result, for `read_result`."""
    return lambda found: kind(**{own.name: getattr(found, own.name) for own in fields(kind)})


class _Fields:
    """The fields of a result, each read when it is asked for."""

    def __init__(self, folder: Path, content: Content, own: Mapping[str, Field[Any]]) -> None:
        self._folder, self._content, self._own = folder, content, own

    def __getattr__(self, name: str) -> object:
        own, plain = self._own[name], self._content.value
        if name in plain:
            # Of a class such as Roi: its own fields.
            return own.type(**plain[name]) if is_dataclass(own.type) else plain[name]  # type: ignore
        stems = {Path(file).stem: file for file in self._content.files}
        if name in stems:
            return self._read(stems[name])
        by_key = {k: file for k, file in stems.items() if k.startswith(f"{name}_")}
        if by_key:
            return {k.removeprefix(f"{name}_"): self._read(file) for k, file in by_key.items()}
        if own.default is MISSING and own.default_factory is MISSING:
            raise KeyError(f"{self._folder} holds no {name}; it holds {[*plain, *stems]}")
        return own.default if own.default_factory is MISSING else own.default_factory()

    def _read(self, file: str) -> object:
        check_files(self._folder, self._content.files, [file], self._folder)
        return _read(self._folder / file)


class DamagedResult(ValueError):
    """A result is not what was written, and counts as not there."""


def damaged(named: object, fault: str) -> DamagedResult:
    return DamagedResult(f"{named} is damaged: {fault}; it is removed, to be computed again")


def _digest(path: Path) -> str:
    """Hash of a file's content. What is mapped afterwards is in the page cache by then. Not one of
    the faster kinds from a package of its own: 1.2 GB/s is more than most disks have."""
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

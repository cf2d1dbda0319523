"""What lies in a store: its entries, and the files in which sweeps refer to results."""

import json
import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

from lidarplace.base.errors import InputError

SWEEPS = "sweeps"
"""Folder next to the stages: one file a sweep, with the keys that the sweep refers to."""

_NAMES = re.compile(
    r"(?P<result>[0-9a-f]{24})"
    r"|\.(?P<working>[0-9a-f]{24})\.working"
    r"|\.(?P<running>[0-9a-f]{24})\.running"
    r"|\.(?P<partial>.+)-\d+-[0-9a-f]{8}\.part"
)


@dataclass(frozen=True)
class Entry:
    """What lies in a stage's folder, a folder or a file. `kind`: "result"; "working", the
    checkpoints of an unfinished training; "running", a note that a task runs; or "partial", what a
    killed process was writing. `key`: of the task; of "partial" any text. `size`: bytes."""

    stage: str
    kind: Literal["result", "working", "running", "partial"]
    name: str
    key: str
    size: int = 0


def entry_of(stage: str, name: str) -> Entry | None:
    """What a name in a stage's folder stands for; None if it is no store's."""
    if not (found := _NAMES.fullmatch(name)):
        return None
    kind: Any = found.lastgroup
    return Entry(stage, kind, name, found[kind])


def keys_in(data: bytes, named: object) -> set[str]:
    """The keys in a sweep's file. Raises ValueError: as good as none would remove its results."""
    keys = None
    with suppress(ValueError):
        keys = json.loads(data)
    if isinstance(keys, list):
        return set(keys)
    expected, fix = "a list of keys", "run the sweep again"
    raise InputError(place=str(named), expected=expected, found=repr(data[:40]), fix=fix)


def size_of(entries: Iterable[Entry]) -> int:
    return sum(entry.size for entry in entries)

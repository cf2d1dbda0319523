"""The entries of a store, and the files in which sweeps refer to results."""

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
    """A folder or file in the folder of a stage.

    `kind`: "result"; "working", the checkpoints of an unfinished training; "running", a note that a
    task runs; or "partial", a file that a killed process was writing. `key`: of the task; of
    "partial" any text. `size`: bytes."""

    stage: str
    kind: Literal["result", "working", "running", "partial"]
    name: str
    key: str
    size: int = 0


def entry_of(stage: str, name: str) -> Entry | None:
    """Return the entry of a name in the folder of a stage; None for other files."""
    if not (match := _NAMES.fullmatch(name)):
        return None
    kind: Any = match.lastgroup
    return Entry(stage, kind, name, match[kind])


def keys_in(data: bytes, named: object) -> set[str]:
    """Return the keys in the file of a sweep. Raises InputError: it is damaged."""
    keys = None
    with suppress(ValueError):
        keys = json.loads(data)
    if isinstance(keys, list):
        return set(keys)
    expected, fix = "a list of keys", "run the sweep again"
    raise InputError(place=str(named), expected=expected, found=repr(data[:40]), fix=fix)


def size_of(entries: Iterable[Entry]) -> int:
    """Return the bytes of entries."""
    return sum(entry.size for entry in entries)

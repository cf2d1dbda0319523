"""Wrong files, whatever is in them: cut, emptied, overwritten, gone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random

Mutation = Callable[[Path, Random], str]
"""Makes one file wrong in place, and says what was done."""


def cut(path: Path, random: Random) -> str:
    data = path.read_bytes()
    path.write_bytes(data[: random.randrange(max(len(data), 1))])
    return "cut"


def emptied(path: Path, random: Random) -> str:
    path.write_bytes(b"")
    return "emptied"


def garbage(path: Path, random: Random) -> str:
    path.write_bytes(random.randbytes(random.choice((1, 8, 300))))
    return "garbage"


def zeros(path: Path, random: Random) -> str:
    path.write_bytes(bytes(len(path.read_bytes())))
    return "zeros"


def overwritten(path: Path, random: Random) -> str:
    data = bytearray(path.read_bytes())
    start = random.randrange(max(len(data), 1))
    data[start : start + random.randint(1, 16)] = random.randbytes(8)
    path.write_bytes(data)
    return "overwritten"


def not_text(path: Path, random: Random) -> str:
    data = path.read_bytes()
    place = random.randrange(len(data) + 1)
    path.write_bytes(
        data[:place] + random.choice((b"\xff\xfe", b"\x00", b"\xed\xa0\x80")) + data[place:]
    )
    return "not text"


def removed(path: Path, random: Random) -> str:
    path.unlink()
    return "removed"


def folder(path: Path, random: Random) -> str:
    path.unlink()
    path.mkdir()
    return "a folder"


def endless_link(path: Path, random: Random) -> str:
    path.unlink()
    path.symlink_to(path.name)
    return "a link to itself"


ANY: tuple[Mutation, ...] = (
    *(cut, emptied, garbage, zeros, overwritten, not_text, removed, folder, endless_link),
)

"""Wrong files, whatever is in them: cut, emptied, overwritten, gone, and no files at all."""

import contextlib
import os
import socket
from collections.abc import Callable
from pathlib import Path
from random import Random

Mutation = Callable[[Path, Random], str]
"""Makes one file wrong in place, and says what was done."""


def _overwritten(data: bytes, random: Random) -> bytes:
    start = random.randrange(max(len(data), 1))
    return data[:start] + random.randbytes(8) + data[start + random.randint(1, 16) :]


def _not_text(data: bytes, random: Random) -> bytes:
    place = random.randrange(len(data) + 1)
    return data[:place] + random.choice((b"\xff\xfe", b"\x00", b"\xed\xa0\x80")) + data[place:]


BYTES: dict[str, Callable[[bytes, Random], bytes]] = {
    "cut": lambda data, random: data[: random.randrange(max(len(data), 1))],
    "emptied": lambda data, random: b"",
    "garbage": lambda data, random: random.randbytes(random.choice((1, 8, 300))),
    "zeros": lambda data, random: bytes(len(data)),
    "overwritten": _overwritten,
    "not text": _not_text,
}


def other_bytes(path: Path, random: Random) -> str:
    """Other content."""
    change = random.choice(list(BYTES))
    path.write_bytes(BYTES[change](path.read_bytes(), random))
    return change


def removed(path: Path, random: Random) -> str:
    path.unlink()
    return "removed"


def no_file(path: Path, random: Random) -> str:
    """A folder, a link or whatever else takes a name without being a file."""
    kind = random.choice(list(NO_FILES))
    path.unlink()
    NO_FILES[kind](path)
    return kind


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made, contextlib.chdir(path.parent):
        made.bind(path.name)  # whose length is limited


NO_FILES: dict[str, Callable[[Path], object]] = {
    "a folder": Path.mkdir,
    "a FIFO": os.mkfifo,
    "a socket": _socket,
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to nothing": lambda path: path.symlink_to("nothing"),
    "a link to a folder": lambda path: path.symlink_to("."),
    "an endless device": lambda path: path.symlink_to("/dev/zero"),
    "an empty device": lambda path: path.symlink_to("/dev/null"),
}

ANY: tuple[Mutation, ...] = (*[other_bytes] * len(BYTES), removed, *[no_file] * 3)

"""Wrong files, whatever is in them: cut, emptied, overwritten, gone, and no files at all."""

import contextlib
import os
import socket
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


def no_file(path: Path, random: Random) -> str:
    """A folder, a link or whatever else takes a name without being a file."""
    what = random.choice(list(NO_FILES))
    path.unlink()
    NO_FILES[what](path)
    return what


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


ANY: tuple[Mutation, ...] = (
    *(cut, emptied, garbage, zeros, overwritten, not_text, removed, no_file, no_file, no_file),
)

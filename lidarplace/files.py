"""Files that appear in one step, so that a reader never meets half of one."""

from __future__ import annotations

import os
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` to write to; it takes the place of `path` at the end."""
    partial = temporary(path)
    try:
        yield partial
        sync(partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def temporary(path: Path) -> Path:
    """A hidden name beside `path` that no other process uses, on whatever host of a shared disk."""
    return path.with_name(f".{path.name}.{unique()}.part")


def unique() -> str:
    """A name that is given once, and tells the host and the process."""
    return f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"


def sync(path: Path) -> None:
    """Wait until a file, or the list of names in a folder, is on the disk.

    Without it a machine that loses power can keep a later rename and lose what was written before.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

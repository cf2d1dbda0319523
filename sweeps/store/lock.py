"""A lock on a store, which many drivers share and cleaning has alone."""

import fcntl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from lidarplace.base.errors import InputError

_FILE = ".lock"
_PATIENCE_S = 1.0
_STEP_S = 0.05


@contextmanager
def locked(folder: Path, alone: bool) -> Iterator[None]:
    """Hold the lock of a store while the block runs; the kernel drops it when the process dies.

    Waits while cleaning has the store alone. `alone` waits a second, as `is_locked` holds the lock
    for a moment, and raises InputError while others hold it. Raises OSError: the file system has no
    locks."""
    folder.mkdir(parents=True, exist_ok=True)
    # NFS shares a lock only on what is open for reading, and gives it alone only for writing.
    with (folder / _FILE).open("a+b") as file:
        give_up = time.monotonic() + _PATIENCE_S
        while not _taken(file, fcntl.LOCK_EX | fcntl.LOCK_NB if alone else fcntl.LOCK_SH):
            if time.monotonic() >= give_up:
                raise InputError("in use by a running sweep", place=folder)
            time.sleep(_STEP_S)
        yield


def is_locked(folder: Path) -> bool:
    """Whether a process has the lock alone.

    Several can look at the same time, and make no file. Raises OSError: the file system has no
    locks, or the lock cannot be read."""
    try:
        file = (folder / _FILE).open("rb")
    except FileNotFoundError:
        return False
    with file:
        return not _taken(file, fcntl.LOCK_SH | fcntl.LOCK_NB)


def _taken(file: BinaryIO, operation: int) -> bool:
    """Lock a file until it is closed; False if others hold the lock."""
    try:
        fcntl.flock(file, operation)
    except BlockingIOError:
        return False
    except OSError as error:
        raise OSError(error.errno, f"cannot be locked: {error.strerror}", file.name) from None
    return True

"""A lock on a store, which many drivers share and cleaning has alone."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def locked(folder: Path, alone: bool) -> Iterator[None]:
    """Hold the lock of a store while the block runs. The kernel drops it when the process dies.

    Waits while cleaning has the store alone.

    Args:
        folder: the store; made if it is not there.
        alone: shut out drivers and other cleaning.

    Raises:
        ValueError: `alone`, and a sweep or another cleaning holds the lock.
        OSError: the filesystem has no locks.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / ".lock"
    with path.open("ab") as file:  # NFS locks only what is open for writing
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB if alone else fcntl.LOCK_SH)
        except BlockingIOError:
            raise ValueError(f"{folder} is in use by a running sweep") from None
        except OSError as error:
            raise OSError(error.errno, f"cannot be locked: {error.strerror}", str(path)) from None
        yield

"""Regular files, all that is read: a FIFO blocks its reader, and a device may have no end."""

import errno
import os
import stat
from pathlib import Path

_KINDS = {"p": "a FIFO", "s": "a socket", "c": "a device", "b": "a device"}


def regular(path: Path) -> Path:
    """Return `path`, which leads to a regular file; every reader of files opens what this returns.

    Raises OSError: it leads to nothing, a folder, a FIFO, a socket or a device; names the file."""
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        kind = _KINDS[stat.filemode(mode)[0]]
        raise OSError(errno.EINVAL, f"expected a regular file, found {kind}", str(path))
    return path


def files_in(folder: Path) -> list[Path]:
    """Return paths in a folder, sorted, without hidden ones. Raises OSError.

    On foreign disks macOS adds a file `._NAME` to each file."""
    return sorted(path for path in folder.iterdir() if not path.name.startswith("."))


def is_there(path: Path) -> bool:
    """Return whether its folder has that name, maybe as a dangling link. Raises OSError."""
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    return True

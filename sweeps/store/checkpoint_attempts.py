"""Folders in which the attempts at one task keep their checkpoints.

Two attempts can overlap: two drivers, or a machine that was believed dead. In one folder the slower
one would put its older checkpoints under the other's feet, so each has its own.
"""

import shutil
from pathlib import Path

from lidarplace.files.atomic import sync, unique
from sweeps.store.whole import whole_folder

Versions = dict[str, tuple[int, int]]
"""By name of a file."""


def new_attempt(folder: Path) -> Path:
    """A new folder in `folder`, with the files of the attempt that wrote last."""
    written = {path: max(found) for path in attempts(folder) if (found := versions(path).values())}
    own = folder / unique()
    with whole_folder(own) as partial:
        if written:
            for name in snapshot(max(written, key=written.__getitem__), partial):
                sync(partial / name)
    return own


def attempts(folder: Path) -> list[Path]:
    """The attempts in `folder`; hidden are those that a killed process was filling."""
    return list(folder.glob("[!.]*"))


def snapshot(source: Path, target: Path) -> Versions:
    """Copy the files of an attempt that may go on to an empty folder, as they are at one moment.

    Checkpoints of different moments do not fit together.

    Returns:
        The versions that were copied.
    """
    copied = Versions()
    while versions(source) != copied:
        for name in copied:
            (target / name).unlink()
        copied = versions(source)
        for name in copied:
            shutil.copy2(source / name, target / name)
    return copied


def versions(folder: Path) -> Versions:
    """What tells each file of a folder, hidden ones aside, from what replaces it: time and inode.

    Files are replaced in one step, as `lidarplace.files.atomic.replacing` does.
    """
    found = {path.name: path.stat() for path in folder.glob("[!.]*")}
    return {name: (status.st_mtime_ns, status.st_ino) for name, status in found.items()}

"""Copy checkpoints to a remote place while a task writes them, so that another machine can go on.

What belongs together is one file there, an archive for each attempt, replaced in one step.
"""

import hashlib
import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from zipfile import BadZipFile, ZipFile

from fsspec import AbstractFileSystem

from lidarplace.files.atomic import sync
from lidarplace.files.secret_urls import hide_secrets
from sweeps.store.whole import put_whole, whole_folder

SECONDS = 5.0
"""Between two looks at the folder."""

Versions = dict[str, tuple[int, int]]
"""By name of a file."""

_ENDING = ".zip"
_TRIES = 3  # to read what another machine is writing


@contextmanager
def mirrored(folder: Path, filesystem: AbstractFileSystem, place: str) -> Iterator[None]:
    """Copy the files of an attempt's folder to the place of the attempts at the task when they have
    changed, and at the end. A remote place that does not answer is logged and tried again: the work
    goes on without it."""
    stop = threading.Event()
    target = f"{place}/{folder.name}{_ENDING}"

    def watch() -> None:
        there: Versions = {}
        last = False
        while not last:
            last = stop.wait(SECONDS)
            try:
                if _versions(folder) != there:
                    there = _copy(folder, filesystem, target)
            except Exception as error:  # each remote place has errors of its own
                told = hide_secrets(f"{target}: cannot be written: {error!r}")
                logging.getLogger(__name__).warning(told)

    thread = threading.Thread(target=watch, name=f"mirror {folder}", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def fetch(filesystem: AbstractFileSystem, place: str, folder: Path) -> None:
    """Copy what the latest of the attempts at `place` left into a new one in `folder`. Nothing is
    new if it was this machine that left it, or fetched it earlier: what is here is that or went on
    from there, also while the remote place did not answer. Names decide, not the clocks of two
    machines: an attempt is called the same here and there, and what was fetched after its content.
    """
    for left in reversed(range(_TRIES)):
        filesystem.invalidate_cache()
        try:
            _fetch_latest(filesystem, place, folder)
            return
        # Removed meanwhile; or a file system that shows an archive before it is whole.
        except (FileNotFoundError, BadZipFile):
            if not left:
                raise


def _fetch_latest(filesystem: AbstractFileSystem, place: str, folder: Path) -> None:
    found = [path for path in filesystem.find(place) if path.endswith(_ENDING)]
    if not found:
        return
    latest = PurePosixPath(max(found, key=filesystem.modified))
    if (folder / latest.stem).exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder, prefix=".") as moment:
        archive = Path(moment, latest.name)
        filesystem.get_file(str(latest), str(archive))
        with archive.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        with (
            whole_folder(folder / f"{latest.stem}-{digest[:16]}") as partial,
            ZipFile(archive) as files,
        ):
            for name in files.namelist():
                sync(Path(files.extract(name, partial)))


def _copy(folder: Path, filesystem: AbstractFileSystem, target: str) -> Versions:
    """Replace `target` by the files of an attempt as they are at one moment: these versions."""
    with TemporaryDirectory(dir=folder, prefix=".") as moment:
        archive, here = Path(moment, "files"), Versions()
        while _versions(folder) != here:
            here = _versions(folder)
            with ZipFile(archive, "w") as files:
                for name in here:
                    files.write(folder / name, name)
        put_whole(filesystem, archive, target)
    return here


def _versions(folder: Path) -> Versions:
    """Time and inode of each file of a folder, hidden ones aside: a replaced file differs."""
    found = {path.name: path.stat() for path in folder.glob("[!.]*")}
    return {name: (status.st_mtime_ns, status.st_ino) for name, status in found.items()}

"""Copy checkpoints to a remote place while a task writes them, so that another machine can resume.

Files of an attempt are one archive there, which is replaced in one step."""

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
"""Seconds between two looks at the folder."""

Versions = dict[str, tuple[int, int]]
"""Time and inode of each file, by name."""

_ENDING = ".zip"
_TRIES = 3  # to read what another machine is writing


@contextmanager
def mirrored(folder: Path, filesystem: AbstractFileSystem, place: str) -> Iterator[None]:
    """Copy the files of an attempt to a remote place when they change, and at the end.

    `place`: of the attempts at the task. If it does not answer, the error is logged and the copy
    tried again, while the work goes on."""
    stop = threading.Event()
    target = f"{place}/{folder.name}{_ENDING}"

    def watch() -> None:
        copied: Versions = {}
        last = False
        while not last:
            last = stop.wait(SECONDS)
            try:
                if _versions(folder) != copied:
                    copied = _copy(folder, filesystem, target)
            except Exception as error:  # each remote place has errors of its own
                text = hide_secrets(f"{target}: cannot be written: {error!r}")
                logging.getLogger(__name__).warning(text)

    thread = threading.Thread(target=watch, name=f"mirror {folder}", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def fetch(filesystem: AbstractFileSystem, place: str, folder: Path) -> None:
    """Copy the files of the latest attempt at `place` into a new attempt in `folder`.

    Not if this machine wrote them, or fetched them earlier: its state is that or a later one, also
    while the remote place did not answer. Names decide, not the clocks of two machines: an attempt
    has the same name locally and remotely, and a fetched one is named after its content."""
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
    archives = [path for path in filesystem.find(place) if path.endswith(_ENDING)]
    if not archives:
        return
    latest = PurePosixPath(max(archives, key=filesystem.modified))
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
    """Replace `target` by the files of an attempt at one moment; return their versions."""
    with TemporaryDirectory(dir=folder, prefix=".") as moment:
        archive, archived = Path(moment, "files"), Versions()
        while _versions(folder) != archived:
            archived = _versions(folder)
            with ZipFile(archive, "w") as files:
                for name in archived:
                    files.write(folder / name, name)
        put_whole(filesystem, archive, target)
    return archived


def _versions(folder: Path) -> Versions:
    """Return the versions of the files of a folder, less hidden ones: a replaced file differs."""
    states = {path.name: path.stat() for path in folder.glob("[!.]*")}
    return {name: (state.st_mtime_ns, state.st_ino) for name, state in states.items()}

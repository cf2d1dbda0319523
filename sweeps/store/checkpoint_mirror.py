"""Copy checkpoints to a remote place while a task writes them, so that another machine can go on.

Every version of a file has a name of its own there. `files.json`, replaced in one step, says which
versions belong together.
"""

from __future__ import annotations

import hashlib
import json
import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from fsspec import AbstractFileSystem

from lidarplace.files.atomic import sync
from lidarplace.files.secret_urls import hide_secrets
from sweeps.store.checkpoint_attempts import Versions, snapshot, versions
from sweeps.store.remote_files import put_whole
from sweeps.store.whole_folder import whole_folder

SECONDS = 5.0
"""Between two looks at the folder."""

_FILES = "files.json"
_TRIES = 3  # to read what another attempt is replacing


@contextmanager
def mirrored(folder: Path, filesystem: AbstractFileSystem, target: str) -> Iterator[None]:
    """Copy the files of `folder` to `target` when they have changed, and at the end.

    A remote place that does not answer is logged and tried again: the work goes on without it.

    Args:
        folder: of an attempt.
        target: an empty folder on `filesystem`.
    """
    stop = threading.Event()

    def watch() -> None:
        there: Versions = {}
        last = False
        while not last:
            last = stop.wait(SECONDS)
            try:
                there = _copy_changed(folder, filesystem, target, there)
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
    """Copy what the latest of the attempts at `place` left into a new one in `folder`.

    Nothing is copied if it was this machine that left it, or fetched it earlier: what is here is
    that or went on from there, also while the remote place did not answer. Names tell, not the
    clocks of two machines: an attempt is called the same here and there, and what was fetched after
    its list of files.

    Args:
        folder: of this machine's attempts at the task.
    """
    for left in reversed(range(_TRIES)):
        filesystem.invalidate_cache()
        try:
            _fetch_latest(filesystem, place, folder)
            return
        # Replaced meanwhile; or a file system that shows a list of files before it is whole.
        except (FileNotFoundError, json.JSONDecodeError):
            if not left:
                raise


def _fetch_latest(filesystem: AbstractFileSystem, place: str, folder: Path) -> None:
    found = [path for path in filesystem.find(place) if path.endswith(f"/{_FILES}")]
    if not found:
        return
    latest = PurePosixPath(max(found, key=filesystem.modified))
    listed = filesystem.cat_file(str(latest))
    own = folder / latest.parent.name
    fetched = own.with_name(f"{own.name}-{hashlib.sha256(listed).hexdigest()[:16]}")
    if own.exists() or fetched.exists():
        return
    with whole_folder(fetched) as partial:
        for name, version in json.loads(listed).items():
            filesystem.get_file(str(latest.with_name(version)), str(partial / name))
            sync(partial / name)


def _copy_changed(
    folder: Path, filesystem: AbstractFileSystem, target: str, there: Versions
) -> Versions:
    """Copy files that are not `there` in this version. Returns the versions that are then."""
    if versions(folder) == there:
        return there
    with TemporaryDirectory(dir=folder, prefix=".") as moment:
        here = snapshot(folder, Path(moment))
        for name, version in here.items():
            if there.get(name) != version:
                filesystem.put_file(f"{moment}/{name}", f"{target}/{_named(name, version)}")
        listed = Path(moment) / _FILES
        names = {name: _named(name, version) for name, version in here.items()}
        listed.write_text(json.dumps(names), encoding="utf-8")
        put_whole(filesystem, listed, f"{target}/{_FILES}")
    for name, version in there.items():
        if here.get(name) != version:
            filesystem.rm_file(f"{target}/{_named(name, version)}")
    return here


def _named(name: str, version: tuple[int, int]) -> str:
    return "-".join(map(str, (name, *version)))

"""Folders, and remote files, that appear in one step: a reader never meets half of one."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from fsspec import AbstractFileSystem

from lidarplace.files.atomic import naming, sync, temporary, unique


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """Return an empty hidden folder that becomes `target` at the end, unless that exists by then.

    Nothing is left of it on an error. The block has to `sync` the files that it writes."""
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = temporary(target)
    try:
        with naming(target):
            partial.mkdir()
            yield partial
            sync(partial)
            try:
                partial.rename(target)
            except OSError:
                if not target.is_dir():  # else another process wrote the same
                    raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def put_whole(filesystem: AbstractFileSystem, path: Path, target: str) -> None:
    """Copy a file to `target` on `filesystem`; a reader never meets half of it."""
    if type(filesystem).mv is AbstractFileSystem.mv:  # no rename: an object store, whose put is one
        filesystem.put_file(str(path), target)
        return
    place = PurePosixPath(target)
    partial = str(place.with_name(f".{place.name}.{unique()}.part"))
    filesystem.put_file(str(path), partial)
    filesystem.mv(partial, target)

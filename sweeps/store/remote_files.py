"""Files that appear in one step at a remote place."""

from pathlib import Path, PurePosixPath

from fsspec import AbstractFileSystem

from lidarplace.files.atomic import unique


def put_whole(filesystem: AbstractFileSystem, path: Path, target: str) -> None:
    """Copy a file to `target` on `filesystem`; a reader never meets half of it."""
    if type(filesystem).mv is AbstractFileSystem.mv:  # no rename: an object store, whose put is one
        filesystem.put_file(str(path), target)
        return
    place = PurePosixPath(target)
    partial = str(place.with_name(f".{place.name}.{unique()}.part"))
    filesystem.put_file(str(path), partial)
    filesystem.mv(partial, target)

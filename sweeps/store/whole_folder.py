"""Folders that appear in one step, so that nobody meets half of one."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lidarplace.files.atomic import naming, sync, temporary


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """An empty hidden folder that becomes `target` at the end, unless that is there by then.

    Nothing is left of it on an error. The block has to `sync` the files that it writes.
    """
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
                if not target.is_dir():  # else another process was faster with the same
                    raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)

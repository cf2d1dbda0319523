"""Folders in which the attempts at one task keep their state, a file that is replaced in one step.

Two attempts can overlap: two drivers, or a machine that was believed dead. In one folder the slower
one would put its older state under the other's feet, so each has its own.
"""

import shutil
from pathlib import Path

from lidarplace.files.atomic import sync, unique
from sweeps.store.whole import whole_folder


def new_attempt(folder: Path) -> Path:
    """A new folder in `folder`, with the state that any attempt wrote last."""
    states = [path for attempt in attempts(folder) for path in attempt.glob("[!.]*")]
    own = folder / unique()
    with whole_folder(own) as partial:
        if states:
            last = max(states, key=lambda path: path.stat().st_mtime_ns)
            sync(Path(shutil.copy2(last, partial / last.name)))
    return own


def attempts(folder: Path) -> list[Path]:
    """The attempts in `folder`; hidden are those that a killed process was filling."""
    return list(folder.glob("[!.]*"))

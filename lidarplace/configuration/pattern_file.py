"""The file of a pattern that does not repeat: a row for each ray, in the order of firing."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError, at
from lidarplace.files.regular import regular
from lidarplace.rigs.scan_pattern import ScanPattern

MOST_ROWS = 20_000_000
OURS = ("azimuth_deg", "elevation_deg")
LIVOX = ("Azimuth/deg", "Zenith/deg")
"""Columns of the files of Livox's simulation; zenith counts down from straight up."""


def read_pattern(path: Path, rays_per_frame: int | None) -> ScanPattern:
    """Read the pattern in the columns OURS or LIVOX of a CSV file, again when it was changed.

    Without `rays_per_frame` all rows are one frame. Raises ValueError: the file cannot be read, has
    neither columns, not one frame of rows, or an angle that is not a number or out of range."""
    with at(key="pattern"), at(path):
        try:
            status = regular(path).stat()
            return _read(path, rays_per_frame, status.st_mtime_ns, status.st_size)
        except OSError as error:
            raise InputError(str(error.strerror)) from None


@lru_cache(maxsize=8)
def _read(path: Path, rays_per_frame: int | None, changed: int, size: int) -> ScanPattern:
    try:
        table = pd.read_csv(path, nrows=MOST_ROWS + 1, skipinitialspace=True)
    except (ValueError, pd.errors.ParserError) as error:
        raise InputError(f"no CSV file: {error}") from None
    names = next((names for names in (OURS, LIVOX) if set(names) <= set(table.columns)), None)
    if names is None:
        needed = f"columns {' and '.join(OURS)}, or {' and '.join(LIVOX)}"
        raise InputError(expected=needed, found=", ".join(map(str, table.columns[:10])))
    if not (rays_per_frame or 1) <= len(table) <= MOST_ROWS:
        needed = f"{rays_per_frame or 1:,} rows, one frame, to {MOST_ROWS:,}"
        raise InputError(expected=needed, found=f"{len(table):,}")
    azimuth, other = (_degrees(table, name) for name in names)
    elevation = other if names is OURS else 90.0 - other
    for row in np.flatnonzero(np.abs(elevation) > 90.0):
        where = {"place": f"row {row + 1}", "key": names[1], "found": f"{other[row]:g}"}
        raise InputError("is not an elevation within ±90 degrees", **where)
    rays = rays_per_frame or len(table)
    return ScanPattern(np.radians(azimuth % 360.0), np.radians(elevation), rays)


def _degrees(table: pd.DataFrame, name: str) -> np.ndarray:
    """Return a column of finite numbers within two turns."""
    angles = pd.to_numeric(table[name], errors="coerce").to_numpy(np.float64)
    for row in np.flatnonzero(~(np.abs(angles) <= 720.0)):
        value = table[name][row]
        raise InputError(place=f"row {row + 1}", key=name, expected="degrees", found=value)
    return angles

"""Meshes of vehicles from files: STL, OBJ, PLY, glTF and what else trimesh reads."""

import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError, at
from lidarplace.files.atomic import first_line
from lidarplace.files.regular import regular
from lidarplace.mounting.mesh import Mesh

MOST_TRIANGLES = 1_000_000
"""Largest number of triangles of a body; more are likelier a scan, or every screw."""
SHORTEST_M, LONGEST_M = 0.5, 40.0  # of a vehicle's longest side
DEEPEST_M = 0.5
"""Largest depth below the ground, metres."""
_LOOKS = re.compile("texture|image|bumpmap|opacity|visual|color|material|metadata")
"""Words in what trimesh reports of parts that it cannot read and a body does not need."""


@contextmanager
def _reports() -> Iterator[list[logging.LogRecord]]:
    """Keep what trimesh logs, and what NumPy warns of on its behalf, from the terminal."""
    log, records = logging.getLogger("trimesh"), BufferingHandler(1000)
    propagate, log.propagate = log.propagate, False
    records.setLevel(logging.WARNING)
    log.addHandler(records)
    try:
        with warnings.catch_warnings(action="ignore"):
            yield records.buffer
    finally:
        log.removeHandler(records)
        log.propagate = propagate


def read_mesh(
    path: Path,
    scale: float = 1.0,
    rotation: NDArray[np.float64] | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Mesh:
    """Read the triangles of a file into the ego frame.

    Args:
        path: STL, OBJ, PLY, glTF, or another format of trimesh.
        scale: metres of a unit of the file.
        rotation: from the axes of the file to those of the ego frame, shape (3, 3).
        origin: where the file's origin is in the ego frame, metres.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not a mesh, has too many triangles, or cannot be meant; names the file.
        ModuleNotFoundError: trimesh is not installed."""
    import trimesh

    with regular(path).open("rb"):  # trimesh reports what it cannot open as an unknown format
        pass
    with at(path), _reports() as reports:
        try:
            read: Any = trimesh.load(path, force="mesh", process=False)
        except ModuleNotFoundError:
            raise
        except Exception as error:  # readers of formats raise whatever comes
            raise InputError(f"not a readable mesh: {first_line(error)}") from None
    turn = np.eye(3) if rotation is None else rotation
    with at(path):
        for record in reports:
            if not _LOOKS.search(record.getMessage()):
                raise InputError("is a damaged mesh", found=record.getMessage())
        if (count := len(read.faces)) > MOST_TRIANGLES:
            most = f"at most {MOST_TRIANGLES:,} triangles"
            raise InputError(expected=most, found=f"{count:,}", fix="simplify the mesh")
        with np.errstate(all="ignore"):  # numbers like 1e300, which `_check_size` reports
            mesh = Mesh(scale * np.asarray(read.vertices) @ turn.T + origin, np.asarray(read.faces))
        _check_size(mesh)
    return mesh


def _check_size(mesh: Mesh) -> None:
    low, high = mesh.triangles.min(axis=(0, 1)), mesh.triangles.max(axis=(0, 1))
    sides = " by ".join(f"{side:,.3g}" for side in high - low) + " m"
    if not SHORTEST_M <= (high - low).max() <= LONGEST_M:
        longest = f"a longest side of {SHORTEST_M:g} to {LONGEST_M:g} m"
        unit = "scale is the metres of a unit of the file, 0.001 for millimetres"
        raise InputError(expected=longest, found=sides, fix=unit)
    origin = "origin is where the file's origin is in the ego frame"
    if low[2] < -DEEPEST_M:
        deepest = f"at most {DEEPEST_M:g} m under the ground"
        depth = f"{-low[2]:.3g} m ({sides})"
        turned = f"{origin}; roll_deg: 90 turns a file whose y axis points up"
        raise InputError(expected=deepest, found=depth, fix=turned)
    if (far := np.abs([low[:2], high[:2]]).max()) > LONGEST_M:
        farthest = f"at most {LONGEST_M:g} m from the middle of the vehicle"
        raise InputError(expected=farthest, found=f"{far:,.3g} m", fix=origin)

"""The body of a vehicle from a mesh file: STL, OBJ, PLY, glTF and what else trimesh reads."""

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

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import first_line
from lidarplace.files.regular import regular
from lidarplace.mounting.mesh import Mesh

MOST_TRIANGLES = 1_000_000
"""Beyond, a scan or a drawing of every screw is likelier than a body."""
SHORTEST_M, LONGEST_M = 0.5, 40.0
"""Of a vehicle's longest side."""
DEEPEST_M = 0.5
"""Below the ground."""
_LOOKS = re.compile("texture|image|bumpmap|opacity|visual|color|material|metadata")
"""In what trimesh reports of parts that it cannot read: a body needs none of them."""


@contextmanager
def _reports() -> Iterator[list[logging.LogRecord]]:
    """Keep what trimesh logs, and what NumPy warns of on its behalf, from the terminal."""
    log, kept = logging.getLogger("trimesh"), BufferingHandler(1000)
    propagate, log.propagate = log.propagate, False
    kept.setLevel(logging.WARNING)
    log.addHandler(kept)
    try:
        with warnings.catch_warnings(action="ignore"):
            yield kept.buffer
    finally:
        log.removeHandler(kept)
        log.propagate = propagate


def read_mesh(
    path: Path,
    scale: float = 1.0,
    rotation: NDArray[np.float64] | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Mesh:
    """Read the triangles of a file into the ego frame.

    Args:
        scale: metres of a unit of the file.
        rotation: from the axes of the file to those of the ego frame, shape (3, 3).
        origin: where the file's origin is in the ego frame, metres.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no mesh, has too many triangles, or cannot be meant; names the file.
        ModuleNotFoundError: trimesh is not installed.
    """
    import trimesh

    with regular(path).open("rb"):  # trimesh says of what it cannot open that it is no known format
        pass
    with _reports() as told:
        try:
            read: Any = trimesh.load(path, force="mesh", process=False)
        except ModuleNotFoundError:
            raise
        except Exception as error:  # readers of formats raise whatever comes
            raise InputError(f"not a readable mesh: {first_line(error)}", place=path) from None
    for record in told:
        if not _LOOKS.search(record.getMessage()):
            raise InputError(f"is a damaged mesh: {record.getMessage()}", place=path)
    if len(read.faces) > MOST_TRIANGLES:
        raise InputError(
            f"{len(read.faces):,} triangles",
            place=path,
            expected=f"at most {MOST_TRIANGLES:,}",
            fix="simplify the mesh",
        )
    turn = np.eye(3) if rotation is None else rotation
    try:
        with np.errstate(all="ignore"):  # numbers like 1e300, which the size check below reports
            mesh = Mesh(scale * np.asarray(read.vertices) @ turn.T + origin, np.asarray(read.faces))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    low, high = mesh.triangles.min(axis=(0, 1)), mesh.triangles.max(axis=(0, 1))
    sides = " by ".join(f"{side:,.3g}" for side in high - low)
    if not SHORTEST_M <= (high - low).max() <= LONGEST_M:
        raise InputError(
            f"is {sides} m; a vehicle has {SHORTEST_M:g} to {LONGEST_M:g} m; scale is the "
            "metres of a unit of the file, 0.001 for millimetres",
            place=path,
        )
    if low[2] < -DEEPEST_M:
        raise InputError(
            f"is {sides} m and reaches {-low[2]:.3g} m under the ground; origin is where the "
            "file's origin is in the ego frame, and roll_deg: 90 turns a file whose y axis "
            "points up",
            place=path,
        )
    if np.abs([low[:2], high[:2]]).max() > LONGEST_M:
        raise InputError(
            f"is up to {np.abs([low[:2], high[:2]]).max():,.3g} m from the middle of the "
            "vehicle; origin is where the file's origin is in the ego frame",
            place=path,
        )
    return mesh

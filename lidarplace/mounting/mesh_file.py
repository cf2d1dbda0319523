"""The body of a vehicle from a mesh file: STL, OBJ, PLY, glTF and what else trimesh reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarplace.files.regular import regular
from lidarplace.mounting.mesh import Mesh

MOST_TRIANGLES = 1_000_000
"""Beyond, a scan or a drawing of every screw is likelier than a body."""

SHORTEST_M, LONGEST_M = 0.5, 40.0
"""Of a vehicle's longest side."""

DEEPEST_M = 0.5
"""Below the ground."""


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
    try:
        read: Any = trimesh.load(path, force="mesh", process=False)
    except ModuleNotFoundError:
        raise
    except Exception as error:  # readers of formats raise whatever comes
        raise ValueError(f"{path}: is no mesh that can be read: {_one_line(error)}") from None
    if len(read.faces) > MOST_TRIANGLES:
        raise ValueError(
            f"{path}: {len(read.faces):,} triangles, allowed are {MOST_TRIANGLES:,}; simplify it"
        )
    turn = np.eye(3) if rotation is None else rotation
    try:
        mesh = Mesh(scale * np.asarray(read.vertices) @ turn.T + origin, np.asarray(read.faces))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    low, high = mesh.triangles.min(axis=(0, 1)), mesh.triangles.max(axis=(0, 1))
    sides = " by ".join(f"{side:,.3g}" for side in high - low)
    if not SHORTEST_M <= (high - low).max() <= LONGEST_M:
        raise ValueError(
            f"{path}: is {sides} m; a vehicle has {SHORTEST_M:g} to {LONGEST_M:g} m; scale is the "
            "metres of a unit of the file, 0.001 for millimetres"
        )
    if low[2] < -DEEPEST_M:
        raise ValueError(
            f"{path}: is {sides} m and reaches {-low[2]:.3g} m under the ground; origin is where "
            "the file's origin is in the ego frame, and roll_deg: 90 turns a file whose y axis "
            "points up"
        )
    if np.abs([low[:2], high[:2]]).max() > LONGEST_M:
        raise ValueError(
            f"{path}: is up to {np.abs([low[:2], high[:2]]).max():,.3g} m from the middle of the "
            "vehicle; origin is where the file's origin is in the ego frame"
        )
    return mesh


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__

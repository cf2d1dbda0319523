"""What the rays of a LiDAR hit of the objects: cells of their surfaces, the same for every LiDAR.

A cell is a cube in the frame of the object itself, so what two mounts hit twice is one cell, and
the cells of a rig are the union of those of its mounts. Mounts whose rings coincide hit the same
cells, where a count of points would take them for twice as much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidarplace.lidar.raycast import Hits, beams_of, returns_light
from lidarplace.placement import Mount
from lidarplace.sensor import Lidar

MOST_CELLS = 2**32
"""Cells of one box."""


@dataclass(frozen=True, eq=False)
class SurfaceCells:
    """What is hit of every object, by rows: the cells of object b are
    `cells[offsets[b]:offsets[b + 1]]`.

    Attributes:
        offsets: int64, shape (objects + 1,).
        cells: numbers of cells within their object, ascending and each once, uint32.
        points: returns from every object, int64, shape (objects,).
    """

    offsets: NDArray[np.int64]
    cells: NDArray[np.uint32]
    points: NDArray[np.int64]

    def counts(self) -> NDArray[np.int64]:
        """Distinct cells of every object, shape (objects,)."""
        return np.diff(self.offsets)

    def and_(self, other: SurfaceCells) -> SurfaceCells:
        """What either of them hits; points add up. Both are of the same objects."""
        offsets, cells = _union(self.offsets, self.cells, other.offsets, other.cells)
        return SurfaceCells(offsets, cells, self.points + other.points)

    @classmethod
    def none(cls, objects: int) -> SurfaceCells:
        """Nothing is hit of any of so many objects."""
        zeros = np.zeros(objects + 1, np.int64)
        return cls(zeros, np.empty(0, np.uint32), zeros[1:].copy())

    @classmethod
    def joined(cls, frames: Sequence[SurfaceCells]) -> SurfaceCells:
        """The objects of several frames, one frame after another."""
        parts = [cls.none(0), *frames]
        counts = np.concatenate([part.counts() for part in parts])
        return cls(
            np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]),
            np.concatenate([part.cells for part in parts]),
            np.concatenate([part.points for part in parts]),
        )


class Surface(NamedTuple):
    """Objects of one frame, as compiled code takes them.

    Attributes:
        geometry: rows of `lidarplace.boxes.GEOMETRY`, float64, shape (objects, 7).
        slices: see `slices_of`.
        owner: row of `geometry` of every owner of `lidarplace.lidar.shapes.Parts`, -1 for one that
            does not count, int64, shape (owners,).
    """

    geometry: NDArray[np.float64]
    slices: NDArray[np.int64]
    owner: NDArray[np.int64]


def slices_of(geometry: NDArray[np.float64], cell: float) -> NDArray[np.int64]:
    """Cells of edge `cell`, metres, along length, width and height, int64, shape (objects, 3).

    Cell (i, j, k) has the number `(i * slices[1] + j) * slices[2] + k`; (0, 0, 0) is at the rear,
    on the right, at the bottom. The last one of an axis may stand over the box.

    Raises:
        ValueError: a box has more than `MOST_CELLS` cells.
    """
    slices = np.maximum(np.ceil(geometry[:, 3:6] / cell - 1e-9), 1.0)
    most = slices.prod(axis=1).max(initial=1.0)
    if most > MOST_CELLS:
        raise ValueError(
            f"a box has {most:.3g} cells of {cell:g} m, allowed are {MOST_CELLS:,}; "
            "its size is wrong, or the cells of the curve are too small"
        )
    return slices.astype(np.int64)


def surface_cells(
    mount: Mount,
    lidar: Lidar,
    hits: Hits,
    surface: Surface,
    crop: Sequence[float],
    cell: float,
) -> SurfaceCells:
    """Cells of the objects of a frame from which one LiDAR gets light within `crop`.

    Args:
        mount, lidar: as cast.
        hits: from `lidarplace.lidar.raycast.cast`.
        surface: the objects that count.
        crop: x0, y0, z0, x1, y1, z1 in the ego frame, metres; the faces belong to it.
        cell: edge of a cell, metres.
    """
    object_of, cell_of = _cells_of_hits(
        mount.position,
        mount.rotation,
        beams_of(lidar),
        hits,
        surface,
        np.array(crop, np.float64),
        cell,
    )
    points = np.bincount(object_of, minlength=len(surface.geometry)).astype(np.int64)
    order = np.lexsort((cell_of, object_of))
    object_of, cell_of = object_of[order], cell_of[order]
    first = np.ones(len(order), np.bool_)
    first[1:] = (np.diff(object_of) != 0) | (np.diff(cell_of) != 0)
    offsets = np.searchsorted(object_of[first], np.arange(len(points) + 1)).astype(np.int64)
    return SurfaceCells(offsets, cell_of[first].astype(np.uint32), points)


@njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _slice(position, size, cell, number):  # pragma: no cover - compiled
    """Which slice holds a position from the middle; rounding does not lead out of the box."""
    return min(max(math.floor((position + 0.5 * size) / cell), 0), number - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _cells_of_hits(
    origin, rotation, beams, hits, surface, crop, cell
):  # pragma: no cover - compiled
    """Object and cell of every return from an object within `crop`."""
    elevations, azimuths = beams.elevations, beams.azimuths
    ranges, targets, reflected = hits
    geometry, slices, owner = surface
    steps = azimuths.shape[1]
    count = 0
    for ray in range(len(targets)):
        count += targets[ray] >= 0
    objects, cells = np.empty(count, np.int64), np.empty(count, np.int64)
    here = np.empty(3)
    count = 0
    for ray in range(len(targets)):
        if targets[ray] < 0 or owner[targets[ray]] < 0:
            continue
        if not returns_light(ranges[ray], reflected[ray], beams):
            continue
        b = owner[targets[ray]]
        beam, step = ray // steps, ray % steps
        dx = elevations[beam, 1] * azimuths[0, step]
        dy = elevations[beam, 1] * azimuths[1, step]
        dz = elevations[beam, 2]
        inside = True
        for axis in range(3):
            along = rotation[axis, 0] * dx + rotation[axis, 1] * dy + rotation[axis, 2] * dz
            here[axis] = origin[axis] + ranges[ray] * along
            inside &= crop[axis] <= here[axis] <= crop[axis + 3]
        if not inside:
            continue
        box = geometry[b]
        x, y, c, s = here[0] - box[0], here[1] - box[1], math.cos(box[6]), math.sin(box[6])
        i = _slice(c * x + s * y, box[3], cell, slices[b, 0])
        j = _slice(c * y - s * x, box[4], cell, slices[b, 1])
        k = _slice(here[2] - box[2], box[5], cell, slices[b, 2])
        objects[count] = b
        cells[count] = (i * slices[b, 1] + j) * slices[b, 2] + k
        count += 1
    return objects[:count], cells[:count]


@njit(cache=True, nogil=True)
def _union(offsets, cells, other_offsets, other_cells):  # pragma: no cover - compiled
    """Merge sorted rows."""
    both = np.zeros(len(offsets), np.int64)
    merged = np.empty(len(cells) + len(other_cells), np.uint32)
    size = 0
    for row in range(len(offsets) - 1):
        a, a_end = offsets[row], offsets[row + 1]
        b, b_end = other_offsets[row], other_offsets[row + 1]
        while a < a_end or b < b_end:
            if b == b_end or (a < a_end and cells[a] <= other_cells[b]):
                merged[size] = cells[a]
                b += b < b_end and other_cells[b] == cells[a]
                a += 1
            else:
                merged[size] = other_cells[b]
                b += 1
            size += 1
        both[row + 1] = size
    return both, merged[:size].copy()

"""Cells of the surfaces of objects that the rays of a LiDAR hit, the same for every LiDAR.

A cell is a cube in the frame of the object itself, so the cells of a rig are the union of those of
its mounts: where rings coincide, a count of points would take them for twice as much.

For every frame `_cells_in_frames`

1. casts the rays at parts and static world (`_cast_in_frame`);
2. marks the cells from which a ray returns, unless it is lost at random (`_mark_cells`);
3. appends the numbers of the marked cells, object by object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import inlined, inner, njit
from lidarplace.clouds.hashed import stream_of, uniform
from lidarplace.clouds.raycast import (
    NO_ENDS,
    Hits,
    Rays,
    Surfaces,
    along,
    cast_compiled,
    lost_share,
    rays_of,
    returns_light,
)
from lidarplace.clouds.static_world import stop_at_world
from lidarplace.clouds.worlds import WorldAround, Worlds
from lidarplace.mounting.housing import turned
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount

MOST_CELLS = 2**24
"""Cells of one box."""


@dataclass(frozen=True, eq=False)
class SurfaceCells:
    """Cells that are hit of every object, by rows.

    Object b has `cells[offsets[b]:offsets[b + 1]]`.

    Attributes:
        offsets: int64, shape (objects + 1,).
        cells: numbers of cells within their object, ascending and each once, uint32.
        points: returns from every object, int64, shape (objects,)."""

    offsets: NDArray[np.int64]
    cells: NDArray[np.uint32]
    points: NDArray[np.int64]

    def counts(self) -> NDArray[np.int64]:
        """Return the number of distinct cells of every object, shape (objects,)."""
        return np.diff(self.offsets)

    def and_(self, other: SurfaceCells) -> SurfaceCells:
        """Return the cells that either of them hits; points add up.

        Both are of the same objects."""
        offsets, cells = _union(self.offsets, self.cells, other.offsets, other.cells)
        return SurfaceCells(offsets, cells, self.points + other.points)

    @classmethod
    def none(cls, objects: int) -> SurfaceCells:
        """Return cells of which none is hit, of so many objects."""
        zeros = np.zeros(objects + 1, np.int64)
        return cls(zeros, np.empty(0, np.uint32), zeros[1:].copy())


class ObjectFrames(NamedTuple):
    """Objects that count and their surroundings, frame by frame, as compiled code takes them.

    Attributes:
        parts: of each frame, the vehicle's own body among them, shape (P, 10), float64.
        owner: row of the object that a part belongs to if that counts, else negative, int32, (P,).
        reflectivity: of the parts, shape (P,), float64.
        first_part, first_object: of each frame, int64, shape (frames + 1,).
        near: x0, y0, z0, x1, y1, z1 that hold all objects of a frame, float64, shape (frames, 6).
        geometry: rows of `lidarplace.logs.boxes.GEOMETRY`, float64, shape (objects, 7).
        slices: see `slices_of`.
        worlds: of the scenes of the frames.
        scene: of each frame in them, -1 where its log has no world, shape (frames,), int64.
        turn, shift: from the ego frame to that of the world, (frames, 3, 3) and (frames, 3)."""

    parts: NDArray[np.float64]
    owner: NDArray[np.int32]
    reflectivity: NDArray[np.float64]
    first_part: NDArray[np.int64]
    first_object: NDArray[np.int64]
    near: NDArray[np.float64]
    geometry: NDArray[np.float64]
    slices: NDArray[np.int64]
    worlds: Worlds
    scene: NDArray[np.int64]
    turn: NDArray[np.float64]
    shift: NDArray[np.float64]


class Loss(NamedTuple):
    """Returns that a LiDAR loses at random, as compiled code takes it.

    Attributes:
        drop_off: probability of a loss without a correction.
        factors: of `Correction` for every object, shape (objects,).
        keys: of every frame for `lidarplace.clouds.hashed`, uint64, shape (frames, 3); no rows:
            none is lost.
        first: number of the first ray, for the random numbers of rays."""

    drop_off: float
    factors: NDArray[np.float64]
    keys: NDArray[np.uint64]
    first: int = 0


NO_LOSS = Loss(0.0, np.empty(0), np.empty((0, 3), np.uint64))


def slices_of(geometry: NDArray[np.float64], cell: float) -> NDArray[np.int64]:
    """Return the cells of edge `cell`, metres, along length, width and height, int64, (objects, 3).

    Cell (i, j, k) has the number `(i * slices[1] + j) * slices[2] + k`; (0, 0, 0) is at the rear,
    on the right, at the bottom. The last one of an axis may stand over the box. Raises ValueError
    if a box has more than `MOST_CELLS`."""
    slices = np.maximum(np.ceil(geometry[:, 3:6] / cell - 1e-9), 1.0)
    most = slices.prod(axis=1).max(initial=1.0)
    if most > MOST_CELLS:
        limit, fix = f"at most {MOST_CELLS:,} cells of a box", "correct its size, or their edge"
        raise InputError(expected=limit, found=f"{most:.3g} of {cell:g} m", fix=fix)
    return slices.astype(np.int64)


def surface_cells(
    mount: Mount,
    lidar: Lidar,
    frames: ObjectFrames,
    crop: Sequence[float],
    cell: float,
    ends: NDArray[np.float64] = NO_ENDS,
    loss: Loss = NO_LOSS,
) -> SurfaceCells:
    """Return the cells of the objects of all `frames` from which one LiDAR gets light.

    Cells have the edge `cell`, metres; returns are within `crop`, see `cast`; `loss`: returns that
    are lost at random."""
    region = _Region(np.array(crop, np.float64), cell)
    blocks = [
        SurfaceCells(
            *_cells_in_frames(
                rays, frames, region, ends[numbers], loss._replace(first=numbers.start)
            )
        )
        for rays, numbers in rays_of(mount, lidar)
    ]
    return reduce(SurfaceCells.and_, blocks)


class _Region(NamedTuple):
    """Crop within which returns count, metres, shape (6,), and edge of a cell, metres."""

    crop: NDArray[np.float64]
    cell: float


class _Returns(NamedTuple):
    """Rays with what they hit in a frame, their loss, and the random numbers of the frame."""

    rays: Rays
    hits: Hits
    loss: Loss
    stream: np.uint64


@njit(cache=True, nogil=True, error_model="numpy")
def _cells_in_frames(rays, frames, region, ends, loss):
    """Return offsets, cells and points of `SurfaceCells`."""
    number = len(rays.beams.elevations) * rays.beams.azimuths.shape[2]
    hits = Hits(np.empty(number), np.empty(number, np.int32), np.empty(number))
    objects, slices = len(frames.geometry), frames.slices
    first_cell = np.zeros(objects + 1, np.int64)
    for b in range(objects):
        first_cell[b + 1] = first_cell[b] + slices[b, 0] * slices[b, 1] * slices[b, 2]
    offsets, points = np.zeros(objects + 1, np.int64), np.zeros(objects, np.int64)
    cells = np.empty(first_cell[-1] + 1, np.uint32)  # one is written and not kept
    size = 0
    for frame in range(len(frames.near)):
        _cast_in_frame(rays, frames, frame, ends, hits)
        first, last = frames.first_object[frame], frames.first_object[frame + 1]
        start = first_cell[first : last + 1] - first_cell[first]
        marked = np.zeros(start[-1], np.bool_)
        stream = stream_of(loss.keys[frame]) if len(loss.keys) > 0 else np.uint64(0)
        returns = _Returns(rays, hits, loss, stream)
        _mark_cells(returns, frames, region, (first, start), marked, points)
        for b in range(first, last):
            for n in range(start[b - first + 1] - start[b - first]):
                cells[size] = n
                size += marked[start[b - first] + n]
            offsets[b + 1] = size
    return offsets, cells[:size].copy(), points


@inner
def _cast_in_frame(rays, frames, frame, ends, hits):
    """Cast the rays at the parts and the static world of a frame."""
    first, last = frames.first_part[frame], frames.first_part[frame + 1]
    owner, light = frames.owner[first:last], frames.reflectivity[first:last]
    surfaces, near = Surfaces(frames.parts[first:last], owner, light), frames.near[frame]
    scene = frames.scene[frame]
    cast_compiled(rays, surfaces, near, ends, hits, scene < 0)
    if scene >= 0:
        around = WorldAround(frames.worlds, scene, frames.turn[frame], frames.shift[frame])
        stop_at_world(rays, around, near, True, True, hits)


@inlined
def _mark_cells(returns, frames, region, cells, marked, points):
    """Mark the cells of a frame from which a ray returns, and count the points of its objects.

    `cells` are the first object of the frame, and where the cells of each begin in `marked`."""
    (rays, hits, loss, stream), (first, start), (crop, edge) = returns, cells, region
    (ranges, targets, reflected), (origin, rotation, beams) = hits, rays
    geometry, slices, steps = frames.geometry, frames.slices, beams.azimuths.shape[2]
    lossy, factors = len(loss.keys) > 0, loss.factors
    for ray in range(len(ranges)):
        b, distance = targets[ray], ranges[ray]
        if b < 0 or not returns_light(distance, reflected[ray], beams):
            continue
        if lossy:
            lost = lost_share(ray, distance, factors[b], loss.drop_off, beams)
            if uniform(stream, np.uint64(2 * (loss.first + ray))) <= lost:
                continue
        beam, step = ray // steps, ray % steps
        cosines, sines = along(beams, beam)
        _, ce, se = beams.elevations[beam]
        dx, dy, dz = turned(rotation, ce * cosines[step], ce * sines[step], se)
        x, y, z = origin[0] + distance * dx, origin[1] + distance * dy, origin[2] + distance * dz
        inside = (crop[0] <= x <= crop[3]) & (crop[1] <= y <= crop[4]) & (crop[2] <= z <= crop[5])
        if inside:
            number = slices[b, 0], slices[b, 1], slices[b, 2]
            cell = _cell_at((x, y, z), geometry[b], edge, number)
            marked[start[b - first] + cell] = True
            points[b] += 1


@inlined
def _cell_at(place, box, cell, slices):
    """Return the number of the cell of a box that holds a place, see `slices_of`."""
    x, y, c, s = place[0] - box[0], place[1] - box[1], math.cos(box[6]), math.sin(box[6])
    i = _slice(c * x + s * y, box[3], cell, slices[0])
    j = _slice(c * y - s * x, box[4], cell, slices[1])
    k = _slice(place[2] - box[2], box[5], cell, slices[2])
    return (i * slices[1] + j) * slices[2] + k


@inlined
def _slice(position, size, cell, number):
    """Return the slice that holds a position from the centre; rounding stays within the box."""
    return min(max(math.floor((position + 0.5 * size) / cell), 0), number - 1)


@njit(cache=True, nogil=True)
def _union(offsets, cells, other_offsets, other_cells):
    """Merge sorted rows of cells."""
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

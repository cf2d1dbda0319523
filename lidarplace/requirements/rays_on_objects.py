"""How many rays of every LiDAR hit each of many objects, past its vehicle and other LiDARs.

Each object is alone there: others hide nothing. Exact, every ray is tested that can meet it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.clouds.convex import enter_along, fill_corners, fill_planes, inner, window
from lidarplace.clouds.raycast import Beams, along, beams_in, beams_of, returns_light, runs
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.clouds.shapes import bricks
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.surface_cells import slices_of
from lidarplace.requirements.placed_object import DARK
from lidarplace.rigs.placement import Placement

MOST_CELLS = 10_000_000
"""Of one object."""

_PORTION = 1024
"""Objects that a thread takes at a time."""
_MOST_BYTES = 2**27
"""Of who hits which cell, in one portion."""
_NOBODY, _SEVERAL = -1, -2


class Sight(NamedTuple):
    """A LiDAR on the vehicle, as compiled code takes it.

    Attributes:
        origin, rotation: of the mount.
        beams: its rays.
        least: of every ray the inverse of the distance at which it ends, at the body, at another
            LiDAR or for want of range, 1/m, shape (rays,).
    """

    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    beams: Beams
    least: NDArray[np.float64]


def sights_of(placement: Placement, vehicle: Vehicle) -> list[Sight]:
    """The LiDARs of a rig."""
    low, high = vehicle.interior[:, 0], vehicle.interior[:, 1]
    body = bricks(np.concatenate([(low + high) / 2, high - low, np.zeros((len(low), 1))], 1), 0)
    sights = []
    lidars = zip(placement.mounts, placement.lidars, ends_in_rig(placement, vehicle), strict=True)
    for mount, lidar, ends in lidars:
        beams = beams_of(lidar)
        least = np.full(lidar.rays, 1.0 / beams.reach * (1.0 - 4e-16))
        if len(ends):
            np.maximum(least, ends, out=least)
        sights.append(Sight(mount.position, mount.rotation, beams, least))
        _shade(sights[-1], body.geometry)
    return sights


@dataclass(frozen=True, eq=False)
class Counts:
    """What a rig has on each of B objects: points, or distinct cells of the surface.

    Attributes:
        all: of all LiDARs together, int64, shape (B,).
        alone: what would be lost without each LiDAR, int64, shape (B, LiDARs).
    """

    all: NDArray[np.int64]
    alone: NDArray[np.int64]


def count_points(
    sights: list[Sight], boxes: NDArray[np.float64], reflectivity: float = DARK
) -> Counts:
    """Rays that hit each box and return.

    Args:
        boxes: rows of `lidarplace.logs.boxes.GEOMETRY`, shape (B, 7).
        reflectivity: of the boxes, for LiDARs whose `range_10` is known; see `Lidar.sight`.
    """

    def points(part: NDArray[np.float64]) -> NDArray[np.int64]:
        owners = np.empty((len(part), 0), np.int16)
        return np.stack(
            [_hit(sight, part, reflectivity, 0, 1.0, owners) for sight in sights], axis=1
        )

    alone = np.concatenate(_in_threads(points, boxes, _PORTION))
    return Counts(alone.sum(axis=1), alone)


def count_cells(
    sights: list[Sight], boxes: NDArray[np.float64], cell: float, reflectivity: float = DARK
) -> Counts:
    """Cells of the surface of each box that are hit, as `lidarplace.recall.surface_cells` has them.

    Args:
        boxes: of one size; rows of `GEOMETRY`, shape (B, 7).
        cell: edge, metres.
        reflectivity: as of `count_points`.

    Raises:
        ValueError: a box has too many cells.
    """
    cells = int(slices_of(boxes[:1], cell).prod())
    if cells > MOST_CELLS:
        raise ValueError(
            f"an object has {cells:,} cells of {cell:g} m, allowed are {MOST_CELLS:,}; make it "
            "smaller, or ask for points"
        )

    def shares(part: NDArray[np.float64]) -> NDArray[np.int64]:
        owners = np.full((len(part), cells), _NOBODY, np.int16)
        for number, sight in enumerate(sights):
            _hit(sight, part, reflectivity, number, cell, owners)
        return _tally(owners, len(sights))

    portion = max(1, min(_PORTION, _MOST_BYTES // (2 * cells)))
    found = np.concatenate(_in_threads(shares, boxes, portion))
    return Counts(found[:, -1].copy(), found[:, :-1])


def _in_threads(
    work: Callable[[NDArray[np.float64]], NDArray[np.int64]],
    boxes: NDArray[np.float64],
    portion: int,
) -> list[NDArray[np.int64]]:
    """What `work` finds for the parts that boxes are, a portion after the other."""
    parts = [bricks(boxes[at : at + portion], 0).geometry for at in range(0, len(boxes), portion)]
    with ThreadPoolExecutor(numba.get_num_threads()) as threads:
        return list(threads.map(work, parts))


@njit(cache=True, nogil=True, error_model="numpy")
def _shade(sight, body):  # pragma: no cover - compiled
    """Let rays end where they enter a part of the body."""
    origin, rotation, beams, least = sight
    steps = beams.azimuths.shape[2]
    corners, planes, enter = np.empty((8, 3)), np.empty((6, 5)), np.empty(steps)
    for part in body:
        fill_corners(part, corners)
        middle, below, above, lowest, highest, _, _ = window(corners, origin, rotation)
        facing = fill_planes(part, origin, rotation, planes)
        if facing == 0:  # it sits inside
            least[:] = np.inf
        for beam in range(*beams_in(beams, middle, below, above)):
            if not lowest <= beams.elevations[beam, 0] <= highest:
                continue
            ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
            cosines, sines = along(beams, beam)
            for first, last in runs(beams, beam, middle, below, above):
                if first < last and facing > 0:
                    enter_along(
                        cosines[first:last], sines[first:last], planes, facing, ce, se, enter
                    )
                    ends = least[beam * steps + first : beam * steps + last]
                    for n in range(len(ends)):
                        ends[n] = max(ends[n], enter[n])


@njit(cache=True, nogil=True, error_model="numpy")
def _hit(sight, parts, reflectivity, number, cell, owners):  # pragma: no cover - compiled
    """Rays of one LiDAR that hit each of `parts`; who hits which cell is kept in `owners`.

    Args:
        number: of the LiDAR.
        owners: the LiDAR that hits a cell, _NOBODY or _SEVERAL, shape (parts, cells); no cells if
            points are all that is asked for.
    """
    origin, rotation, beams, least = sight
    steps = beams.azimuths.shape[2]
    corners, planes, enter = np.empty((8, 3)), np.empty((6, 5)), np.empty(steps)
    counts, frame = np.zeros(len(parts), np.int64), np.empty((3, 4))
    most = 1.0 / beams.nearest if beams.nearest > 0.0 else np.inf  # nearer there is no return
    for p in range(len(parts)):
        framed, nx, ny, nz = False, 1, 1, 1
        fill_corners(parts[p], corners)
        middle, below, above, lowest, highest, near, _ = window(corners, origin, rotation)
        if near > beams.reach:
            continue
        facing = fill_planes(parts[p], origin, rotation, planes)
        if facing == 0:
            continue
        for beam in range(*beams_in(beams, middle, below, above)):
            if not lowest <= beams.elevations[beam, 0] <= highest:
                continue
            ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
            cosines, sines = along(beams, beam)
            for first, last in runs(beams, beam, middle, below, above):
                if first >= last:
                    continue
                enter_along(cosines[first:last], sines[first:last], planes, facing, ce, se, enter)
                ends = least[beam * steps + first : beam * steps + last]
                if beams.sight_10 < np.inf:
                    fired = cosines[first:last], sines[first:last]
                    _put_out(enter, ends, fired, planes, facing, ce, se, reflectivity, beams)
                met = 0
                for n in range(len(ends)):
                    enter[n] = enter[n] if enter[n] <= most else 0.0
                    met += enter[n] > ends[n]
                counts[p] += met
                if met == 0 or owners.shape[1] == 0:
                    continue
                if not framed:
                    nx, ny, nz = _frame(sight, parts[p], cell, frame)
                    framed = True
                level = ce * cosines[first:last], ce * sines[first:last]
                x0, x1, x2 = frame[0, 0], frame[0, 1], frame[0, 2] * se
                y0, y1, y2 = frame[1, 0], frame[1, 1], frame[1, 2] * se
                z0, z1, z2 = frame[2, 0], frame[2, 1], frame[2, 2] * se
                for n in range(len(ends)):
                    if enter[n] <= ends[n]:
                        continue
                    reach, dx, dy = 1.0 / enter[n], level[0][n], level[1][n]
                    i = _slice(frame[0, 3] + reach * (x0 * dx + x1 * dy + x2), nx)
                    j = _slice(frame[1, 3] + reach * (y0 * dx + y1 * dy + y2), ny)
                    k = _slice(frame[2, 3] + reach * (z0 * dx + z1 * dy + z2), nz)
                    here = (i * ny + j) * nz + k
                    owner = owners[p, here]
                    if owner == _NOBODY:
                        owners[p, here] = number
                    elif owner != number:
                        owners[p, here] = _SEVERAL
    return counts


@inner
def _put_out(
    enter, ends, fired, planes, facing, ce, se, reflectivity, beams
):  # pragma: no cover - compiled
    """Let rays miss that meet too little light; Lambert's law at the face that each enters.

    `fired` has cosines and sines of their azimuths, `ce` and `se` are of the elevation.
    """
    for n in range(len(ends)):
        if enter[n] <= ends[n]:
            continue
        least, cosine = np.inf, 0.0
        for k in range(facing):
            a, b, c = ce * planes[k, 0], ce * planes[k, 1], se * planes[k, 2] + planes[k, 3]
            here = a * fired[0][n] + b * fired[1][n] + c
            cosine = here * planes[k, 4] if here < least else cosine
            least = min(least, here)
        if not returns_light(1.0 / enter[n], reflectivity * min(cosine, 1.0), beams):
            enter[n] = 0.0


@inner
def _frame(sight, part, cell, frame):  # pragma: no cover - compiled
    """Fill `frame`: from the sensor's to that of the cells, whose edge is the unit of length.

    Its last column is where the sensor is. Returns the number of cells along each axis.
    """
    c, s = np.cos(part[6]), np.sin(part[6])
    for k in range(4):
        if k < 3:
            x, y, z = sight.rotation[0, k], sight.rotation[1, k], sight.rotation[2, k]
        else:
            x, y, z = (
                sight.origin[0] - part[0],
                sight.origin[1] - part[1],
                sight.origin[2] - part[2],
            )
        frame[0, k], frame[1, k], frame[2, k] = c * x + s * y, c * y - s * x, z
    for axis in range(3):
        frame[axis, 3] += 0.5 * part[3 + axis]
        for k in range(4):
            frame[axis, k] /= cell
    slices = np.maximum(np.ceil(part[3:6] / cell - 1e-9), 1.0)
    return int(slices[0]), int(slices[1]), int(slices[2])


@inner
def _slice(place, number):  # pragma: no cover - compiled
    """Which slice of an axis holds a place; rounding does not lead out of the box."""
    return min(max(int(np.floor(place)), 0), number - 1)


@njit(cache=True, nogil=True)
def _tally(owners, lidars) -> NDArray[np.int64]:  # pragma: no cover - compiled
    """Cells that each LiDAR alone hits, and in the last column those that any hits."""
    counts = np.zeros((len(owners), lidars + 1), np.int64)
    for p in range(len(owners)):
        for owner in owners[p]:
            if owner != _NOBODY:
                counts[p, lidars] += 1
                if owner >= 0:
                    counts[p, owner] += 1
    return counts

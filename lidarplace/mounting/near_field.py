"""How much of the space right around the vehicle its LiDARs see."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.base.roi import Roi
from lidarplace.coverage.cone import cone_bits
from lidarplace.coverage.tiles import Tiles
from lidarplace.mounting.housing import housings_in
from lidarplace.mounting.sight import obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle, voxels_in_body
from lidarplace.rigs.placement import Placement


def seen_in_columns(
    placement: Placement,
    vehicle: Vehicle,
    roi: Roi,
    sets: Sequence[Sequence[int]] | None = None,
    sensors: int = 1,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Voxels of every column of a near field that so many `sensors` see, shape (sets, nx, ny), and
    all that count, shape (nx, ny).

    A voxel counts if its centre is outside of the body. It is seen if some LiDAR covers it, by the
    exact cones of `lidarplace.coverage.cone`, and neither body nor another LiDAR is in the straight
    line from that LiDAR to its centre. `sets`: numbers of the LiDARs that see, by default one set
    of all; the others still hide what is behind them. Each ray is looked at once."""
    every, tiles = range(len(placement.mounts)), Tiles.whole(roi.shape)
    sets = [every] if sets is None else sets
    working = [n for n in every if any(n in own for own in sets)]
    works = np.array([[n in own for n in working] for own in sets], np.bool_)
    bits = np.zeros((len(working), math.ceil(roi.shape[2] / 64), *roi.shape[:2]), np.uint64)
    for row, n in enumerate(working):
        own = Placement("one", [placement.mounts[n]], placement.lidars[n])
        bits[row] = cone_bits(own, roi, tiles)
    origins = np.array([placement.mounts[n].position for n in working]).reshape(-1, 3)
    numbers, (xs, ys, zs) = np.array(working, np.int64), map(roi.centres, range(3))
    inside, obstacles = voxels_in_body(vehicle, roi), obstacles_of(vehicle, housings_in(placement))
    works = works.reshape(len(sets), len(working))
    return _count_seen(bits, numbers, origins, xs, ys, zs, inside, obstacles, works, sensors)


@njit(cache=True, nogil=True, error_model="numpy")
def _count_seen(
    bits, numbers, origins, xs, ys, zs, inside, obstacles, works, sensors
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Voxels that are covered and in sight of so many sensors that work, a layer for each row of
    `works`, and voxels outside of the body."""
    seen = np.zeros((len(works), len(xs), len(ys)), np.int64)
    outside = np.zeros((len(xs), len(ys)), np.int64)
    counts = np.empty(len(works), np.int64)
    for i, j, k in np.ndindex(inside.shape):
        if inside[i, j, k]:
            continue
        outside[i, j] += 1
        counts[:] = 0
        for s in range(len(origins)):
            needed = False
            for row in range(len(works)):
                needed |= works[row, s] and counts[row] < sensors
            covered = bits[s, k >> 6, i, j] >> np.uint64(k & 63) & np.uint64(1)
            if not covered or not needed:
                continue
            origin = origins[s]
            dx, dy, dz = xs[i] - origin[0], ys[j] - origin[1], zs[k] - origin[2]
            if not stopped(origin, dx, dy, dz, 1.0, obstacles, numbers[s]):
                for row in range(len(works)):
                    counts[row] += works[row, s]
        for row in range(len(works)):
            seen[row, i, j] += counts[row] >= sensors
    return seen, outside


def seen_voxels(placement: Placement, vehicle: Vehicle, roi: Roi) -> NDArray[np.bool_]:
    """Which voxels a single LiDAR sees, as in `seen_in_columns`; shape of the ROI."""
    bits = cone_bits(placement, roi, Tiles.whole(roi.shape))
    (mount,), obstacles = placement.mounts, obstacles_of(vehicle, housings_in(placement))
    inside, (xs, ys, zs) = voxels_in_body(vehicle, roi), map(roi.centres, range(3))
    return np.asarray(_in_sight(bits, mount.position, xs, ys, zs, inside, obstacles))


@njit(cache=True, nogil=True, error_model="numpy")
def _in_sight(bits, origin, xs, ys, zs, inside, obstacles) -> NDArray[np.bool_]:
    """Voxels that are covered and in sight of LiDAR 0."""
    seen = np.zeros(inside.shape, np.bool_)
    for i, j, k in np.ndindex(inside.shape):
        covered = bits[k >> 6, i, j] >> np.uint64(k & 63) & np.uint64(1)
        if covered and not inside[i, j, k]:
            dx, dy, dz = xs[i] - origin[0], ys[j] - origin[1], zs[k] - origin[2]
            seen[i, j, k] = not stopped(origin, dx, dy, dz, 1.0, obstacles, 0)
    return seen

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
from lidarplace.mounting.vehicle import Vehicle, poses_of, voxels_in_body
from lidarplace.rigs.placement import Placement


def near_field_coverage(placement: Placement, vehicle: Vehicle, roi: Roi) -> float:
    """Share of the voxels of a near field that the placement sees, in [0, 1]; the least of all
    poses of the vehicle.

    A voxel counts if its centre lies outside of the body. It is seen if some LiDAR covers it, by
    the exact cones of `lidarplace.coverage.cone`, and the straight line from that LiDAR to its
    centre does not pass through the body or another LiDAR.

    Args:
        roi: the near field; it may hold the vehicle.

    Raises:
        ValueError: every voxel has its centre inside of the body.
    """
    shares = []
    for pose in poses_of(vehicle).values():
        seen, outside = seen_in_columns(placement, pose, roi)
        if not outside.any():
            raise ValueError(
                f"the near field x {list(roi.x)}, y {list(roi.y)}, z {list(roi.z)} m needs a voxel "
                f"outside of the body of vehicle {vehicle.name!r}, found none"
            )
        shares.append(int(seen.sum()) / int(outside.sum()))
    return min(shares)


def seen_in_columns(
    placement: Placement, vehicle: Vehicle, roi: Roi, dead: int | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Voxels of every column that count, as in `near_field_coverage`: those seen, and all.

    Args:
        dead: number of a LiDAR that sees nothing; it still hides what is behind it.

    Returns two arrays of shape (nx, ny).
    """
    seen, outside = seen_without(placement, vehicle, roi, [() if dead is None else (dead,)])
    return seen[0], outside


def sensors_over_columns(
    placement: Placement, vehicle: Vehicle, roi: Roi
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """How many LiDARs see a voxel of every column, and its voxels outside of the body.

    Returns two arrays of shape (nx, ny).
    """
    numbers = range(len(placement.mounts))
    others = [tuple(n for n in numbers if n != own) for own in numbers]
    seen, outside = seen_without(placement, vehicle, roi, others)
    return (seen > 0).sum(axis=0), outside


def seen_without(
    placement: Placement,
    vehicle: Vehicle,
    roi: Roi,
    dead: Sequence[tuple[int, ...]],
    sensors: int = 1,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """As `seen_in_columns`, without each of several sets of LiDARs, each ray being looked at once.

    Args:
        dead: numbers of the LiDARs in each set.
        sensors: so many LiDARs have to see a voxel.

    Returns:
        Voxels that are seen, shape (sets, nx, ny), and all that count, shape (nx, ny).
    """
    tiles = Tiles.whole(roi.shape)
    always = set(range(len(placement.mounts))).intersection(*map(set, dead))
    working = [number for number in range(len(placement.mounts)) if number not in always]
    works = np.array([[number not in own for number in working] for own in dead], np.bool_)
    bits = np.zeros((len(working), math.ceil(roi.shape[2] / 64), *roi.shape[:2]), np.uint64)
    for row, number in enumerate(working):
        own = Placement("one", [placement.mounts[number]], placement.lidars[number])
        bits[row] = cone_bits(own, roi, tiles)
    origins = np.array([placement.mounts[number].position for number in working]).reshape(-1, 3)
    xs, ys, zs = map(roi.centres, range(3))
    numbers, housings = np.array(working, np.int64), housings_in(placement)
    inside = voxels_in_body(vehicle, roi)
    obstacles = obstacles_of(vehicle, housings)
    works = works.reshape(len(dead), len(working))
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
    for i in range(len(xs)):
        for j in range(len(ys)):
            for k in range(len(zs)):
                x, y, z = xs[i], ys[j], zs[k]
                if inside[i, j, k]:
                    continue
                outside[i, j] += 1
                counts[:] = 0
                for s in range(len(origins)):
                    covered = bits[s, k >> 6, i, j] >> np.uint64(k & 63) & np.uint64(1)
                    origin = origins[s]
                    dx, dy, dz = x - origin[0], y - origin[1], z - origin[2]
                    needed = False
                    for row in range(len(works)):
                        needed |= works[row, s] and counts[row] < sensors
                    if not covered or not needed:
                        continue
                    if not stopped(origin, dx, dy, dz, 1.0, obstacles, numbers[s]):
                        for row in range(len(works)):
                            counts[row] += works[row, s]
                for row in range(len(works)):
                    seen[row, i, j] += counts[row] >= sensors
    return seen, outside


def seen_voxels(placement: Placement, vehicle: Vehicle, roi: Roi) -> NDArray[np.bool_]:
    """Which voxels a single LiDAR sees, as in `near_field_coverage`; shape of the ROI."""
    bits = cone_bits(placement, roi, Tiles.whole(roi.shape))
    xs, ys, zs = map(roi.centres, range(3))
    (mount,), obstacles = placement.mounts, obstacles_of(vehicle, housings_in(placement))
    inside = voxels_in_body(vehicle, roi)
    return np.asarray(_in_sight(bits, mount.position, xs, ys, zs, inside, obstacles))


@njit(cache=True, nogil=True, error_model="numpy")
def _in_sight(bits, origin, xs, ys, zs, inside, obstacles) -> NDArray[np.bool_]:
    """Voxels that are covered and in sight of LiDAR 0."""
    seen = np.zeros(inside.shape, np.bool_)
    for i in range(len(xs)):
        for j in range(len(ys)):
            for k in range(len(zs)):
                covered = bits[k >> 6, i, j] >> np.uint64(k & 63) & np.uint64(1)
                if covered and not inside[i, j, k]:
                    dx, dy, dz = xs[i] - origin[0], ys[j] - origin[1], zs[k] - origin[2]
                    seen[i, j, k] = not stopped(origin, dx, dy, dz, 1.0, obstacles, 0)
    return seen

"""How much of the space right around the vehicle its LiDARs see."""

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
    all that count, shape (nx, ny). A voxel counts if its centre is outside of the body. `sets`:
    numbers of the LiDARs that see, by default one set of all; the others still hide what is behind
    them."""
    sets = [range(len(placement.mounts))] if sets is None else sets
    numbers = {n for own in sets for n in own}
    by = {n: seen_voxels(placement, vehicle, roi, n) for n in numbers}
    seen = np.empty((len(sets), *roi.shape[:2]), np.int64)
    for layer, own in zip(seen, sets, strict=True):
        number = np.zeros(roi.shape, np.uint8)
        for n in own:
            number += by[n]
        layer[:] = (number >= sensors).sum(axis=2)
    return seen, (~voxels_in_body(vehicle, roi)).sum(axis=2)


def seen_voxels(
    placement: Placement, vehicle: Vehicle, roi: Roi, number: int = 0
) -> NDArray[np.bool_]:
    """Which voxels a LiDAR of a rig sees, shape of the ROI: those outside of the body that it
    covers, by the exact cones of `lidarplace.coverage.cone`, where neither body nor another LiDAR
    is in the straight line from it to the centre."""
    mount, lidar = placement.mounts[number], placement.lidars[number]
    bits = cone_bits(Placement("one", [mount], lidar), roi, Tiles.whole(roi.shape))
    obstacles = obstacles_of(vehicle, housings_in(placement))
    inside, (xs, ys, zs) = voxels_in_body(vehicle, roi), map(roi.centres, range(3))
    return np.asarray(_in_sight(bits, mount.position, xs, ys, zs, inside, obstacles, number))


@njit(cache=True, nogil=True, error_model="numpy")
def _in_sight(bits, origin, xs, ys, zs, inside, obstacles, own) -> NDArray[np.bool_]:
    """Voxels that are covered and in sight of the LiDAR number `own`."""
    seen = np.zeros(inside.shape, np.bool_)
    for i, j, k in np.ndindex(inside.shape):
        covered = bits[k >> 6, i, j] >> np.uint64(k & 63) & np.uint64(1)
        if covered and not inside[i, j, k]:
            dx, dy, dz = xs[i] - origin[0], ys[j] - origin[1], zs[k] - origin[2]
            seen[i, j, k] = not stopped(origin, dx, dy, dz, 1.0, obstacles, own)
    return seen

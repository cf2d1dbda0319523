"""Share of the space right around the vehicle that its LiDARs see."""

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
    """Count voxels of each column of a near field that at least `sensors` LiDARs see.

    Returns the counts, shape (sets, nx, ny), and the voxels that count, shape (nx, ny): those whose
    centre is outside of the body. `sets`: numbers of the LiDARs that see, by default one set of
    all; the others still hide what is behind them."""
    sets = [range(len(placement.mounts))] if sets is None else sets
    numbers = {number for lidars in sets for number in lidars}
    seen_by = {number: seen_voxels(placement, vehicle, roi, number) for number in numbers}
    seen = np.empty((len(sets), *roi.shape[:2]), np.int64)
    for layer, lidars in zip(seen, sets, strict=True):
        seeing = np.zeros(roi.shape, np.uint8)
        for number in lidars:
            seeing += seen_by[number]
        layer[:] = (seeing >= sensors).sum(axis=2)
    return seen, (~voxels_in_body(vehicle, roi)).sum(axis=2)


def seen_voxels(
    placement: Placement, vehicle: Vehicle, roi: Roi, number: int = 0
) -> NDArray[np.bool_]:
    """Return which voxels a LiDAR of a rig sees, shape of the ROI.

    Seen are voxels outside of the body that it covers, by the exact cones of
    `lidarplace.coverage.cone`, where neither body nor another LiDAR is in the straight line from it
    to the centre."""
    mount, lidar = placement.mounts[number], placement.lidars[number]
    bits = cone_bits(Placement("one", [mount], lidar), roi, Tiles.whole(roi.shape))
    obstacles = obstacles_of(vehicle, housings_in(placement))
    inside, centres = voxels_in_body(vehicle, roi), tuple(map(roi.centres, range(3)))
    return np.asarray(_in_sight(bits, mount.position, centres, inside, obstacles, number))


@njit(cache=True, nogil=True, error_model="numpy")
def _in_sight(bits, origin, centres, inside, obstacles, lidar) -> NDArray[np.bool_]:
    """Return voxels that are covered and in sight of the LiDAR number `lidar`."""
    seen, (xs, ys, zs) = np.zeros(inside.shape, np.bool_), centres
    for i, j, k in np.ndindex(inside.shape):
        covered = bits[k >> 6, i, j] >> np.uint64(k & 63) & np.uint64(1)
        if covered and not inside[i, j, k]:
            dx, dy, dz = xs[i] - origin[0], ys[j] - origin[1], zs[k] - origin[2]
            seen[i, j, k] = not stopped(origin, dx, dy, dz, 1.0, obstacles, lidar)
    return seen

"""How much of what a LiDAR fires meets the vehicle's own body."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.mounting.housing import NO_HOUSINGS
from lidarplace.mounting.sight import obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle, poses_of
from lidarplace.rigs.lidar import Lidar, unit_vectors
from lidarplace.rigs.placement import Mount, blocks

AZIMUTH_STEPS = 360


def body_share(
    mount: Mount,
    lidar: Lidar,
    vehicle: Vehicle,
    azimuth_steps: int = AZIMUTH_STEPS,
    others: NDArray[np.float64] = NO_HOUSINGS,
) -> float:
    """Share of the LiDAR's rays that meet the body, or another LiDAR, within its range, in [0, 1];
    the largest of all poses of the vehicle.

    1 for a mount inside the body; 0 on the roof of a box for rays that do not point down.

    Args:
        others: housings of the other LiDARs, rows of `lidarplace.mounting.housing`.
        azimuth_steps: at most so many of the fired azimuths are looked at, at least 1, evenly
            spread over the field of view; all rays of a pattern. With 360 of 5,625 the share of the
            paper's LiDAR is off by at most 0.2 percent points.
    """
    azimuths, rays = lidar.azimuths(), 0
    obstacles = [obstacles_of(pose, others) for pose in poses_of(vehicle).values()]
    hits = np.zeros(len(obstacles))
    if lidar.pattern is None:
        number = min(lidar.fired_steps, azimuth_steps)
        azimuths = azimuths[(2 * np.arange(number) + 1) * lidar.fired_steps // (2 * number)]
    for own_mount, own, _ in blocks(mount, lidar):
        fired = unit_vectors(np.asarray(own.elevations), azimuths) @ own_mount.rotation.T
        hits += [_count_hits(own_mount.position, fired, lidar.reach, own) for own in obstacles]
        rays += len(fired)
    return float(hits.max() / rays)


@njit(cache=True, nogil=True, error_model="numpy")
def _count_hits(origin, directions, reach, obstacles):
    """Number of rays that are stopped closer than `reach`."""
    hits = 0
    for ray in range(len(directions)):
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        hits += stopped(origin, dx, dy, dz, reach, obstacles, -1)
    return hits

"""How much of what a LiDAR fires meets the vehicle's own body."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidarplace.mounting.housing import NO_HOUSINGS
from lidarplace.mounting.sight import obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.placement import Mount
from lidarplace.sensor import Lidar

AZIMUTH_STEPS = 360


def body_share(
    mount: Mount,
    lidar: Lidar,
    vehicle: Vehicle,
    azimuth_steps: int = AZIMUTH_STEPS,
    others: NDArray[np.float64] = NO_HOUSINGS,
) -> float:
    """Share of the LiDAR's rays that meet the body, or another LiDAR, within its range, in [0, 1].

    1 for a mount inside the body; 0 on the roof of a box for rays that do not point down.

    Args:
        others: housings of the other LiDARs, rows of `lidarplace.mounting.housing`.
        azimuth_steps: so many of the fired azimuths are looked at, evenly spread over the field of
            view; all if it has no more. With 360 of 5,625 the share of the paper's LiDAR is off by
            at most 0.2 percent points.

    Raises:
        ValueError: azimuth_steps is below 1.
    """
    if azimuth_steps < 1:
        raise ValueError(f"azimuth_steps must be at least 1, found {azimuth_steps}")
    fired = lidar.fired_steps
    number = min(fired, azimuth_steps)
    steps = lidar.first_step + (2 * np.arange(number) + 1) * fired // (2 * number)
    azimuths = steps * (2 * math.pi / lidar.azimuth_steps)
    elevations, obstacles = np.array(lidar.elevations), obstacles_of(vehicle, others)
    hits = _count_hits(mount.position, mount.rotation, azimuths, elevations, lidar.reach, obstacles)
    return hits / (number * lidar.beams)


@njit(cache=True, nogil=True, error_model="numpy")
def _count_hits(
    origin, rotation, azimuths, elevations, reach, obstacles
):  # pragma: no cover - compiled
    """Number of rays that are stopped closer than `reach`."""
    hits = 0
    flat = np.empty((len(azimuths), 3))
    for j in range(len(azimuths)):
        c, s = math.cos(azimuths[j]), math.sin(azimuths[j])
        for axis in range(3):
            flat[j, axis] = c * rotation[axis, 0] + s * rotation[axis, 1]
    for elevation in elevations:
        c, s = math.cos(elevation), math.sin(elevation)
        ux, uy, uz = s * rotation[0, 2], s * rotation[1, 2], s * rotation[2, 2]
        for j in range(len(flat)):
            dx, dy, dz = c * flat[j, 0] + ux, c * flat[j, 1] + uy, c * flat[j, 2] + uz
            hits += stopped(origin, dx, dy, dz, reach, obstacles, -1)
    return hits

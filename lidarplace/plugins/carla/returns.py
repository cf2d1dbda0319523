"""CARLA's LiDAR returns as points in the ego frame."""

import math

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.clouds.clouds import Crop
from lidarplace.rigs.lidar import HAIR, Lidar
from lidarplace.rigs.placement import Mount

BODY_MARGIN_M = 0.1
"""Mirrors and aerials reach so far out of the ego's box; returns from it are left out."""

Points = NDArray[np.float32]


def ego_points(
    returns: Points, mount: Mount, lidar: Lidar, crop: Crop, body: tuple[float, float, float]
) -> Points:
    """Points in the ego frame, without those out of sight, out of `crop` and on the own body.

    CARLA fired the full turn: the field of view of `lidar` counts. `returns` are x, y, z, intensity
    in the sensor's left-handed frame, shape (n, 4); `body` is the ego's length, width and height.
    """
    turn = mount.rotation @ np.diag([1.0, -1.0, 1.0])  # from the left-handed frame
    low, high = lidar.azimuth
    view = (-math.inf if lidar.full_turn else low - HAIR, high - low)
    points, box = np.empty((len(returns), 4), np.float32), np.array(body)
    limits = np.array(crop), box, BODY_MARGIN_M
    return points[: _ego_points(returns, turn, mount.position, view, *limits, points)]


@njit(cache=True)
def _ego_points(returns, turn, place, view, crop, body, margin, points):
    """Fill `points`, return their number; `view` is the first azimuth, or -inf, and the width."""
    count = 0
    for n in range(len(returns)):
        x, y, z = float(returns[n, 0]), float(returns[n, 1]), float(returns[n, 2])
        # CARLA's y is to the right.
        if view[0] > -math.inf and (math.atan2(-y, x) - view[0]) % (2 * math.pi) >= view[1]:
            continue
        px = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + place[0]
        py = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + place[1]
        pz = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + place[2]
        if not (crop[0] <= px <= crop[3] and crop[1] <= py <= crop[4] and crop[2] <= pz <= crop[5]):
            continue
        if (
            abs(px) <= 0.5 * body[0] + margin
            and abs(py) <= 0.5 * body[1] + margin
            and abs(pz - 0.5 * body[2]) <= 0.5 * body[2] + margin
        ):
            continue
        points[count, 0], points[count, 1], points[count, 2] = px, py, pz
        points[count, 3] = returns[n, 3]
        count += 1
    return count

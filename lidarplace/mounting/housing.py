"""The housings of LiDARs, which hide what is behind them from the others of a rig.

A housing is a box around the origin of the sensor's frame and along its axes, or an upright
cylinder where length and width are equal. A LiDAR whose size is not known hides nothing.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

COLUMNS = 17
"""Of a housing: the number of its LiDAR, its origin, its rotation row by row, half its length,
width and height, and whether it is round; metres."""

NO_HOUSINGS = np.empty((0, COLUMNS))


def housings_of(mounts: Sequence[Mount], lidars: Sequence[Lidar]) -> NDArray[np.float64]:
    """The housings of the LiDARs of known size of a rig, shape (n, COLUMNS)."""
    rows = [
        [
            number,
            *mount.position,
            *mount.rotation.ravel(),
            *(0.5 * side for side in lidar.size),
            lidar.size[0] == lidar.size[1],
        ]
        for number, (mount, lidar) in enumerate(zip(mounts, lidars, strict=True))
        if lidar.size is not None
    ]
    return np.array(rows, np.float64).reshape(-1, COLUMNS)


def housings_in(rig: Placement) -> NDArray[np.float64]:
    """The housings of a rig, those of its dead LiDARs behind the others, shape (n, COLUMNS)."""
    every = [*zip(rig.mounts, rig.lidars, strict=True), *rig.dead]
    return housings_of([mount for mount, _ in every], [lidar for _, lidar in every])


def without(housings: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """The housings of all LiDARs but one: what can stand in its way."""
    return np.asarray(housings[housings[:, 0] != number])


@njit(cache=True, nogil=True, error_model="numpy")
def enter_housing(px, py, pz, vx, vy, vz, housing):
    """Where a ray p + t v, in the frame of a housing, is inside of it first, t >= 0.

    0 for one that starts inside, inf for one that never is; a touch does not count.
    """
    half_x, half_y, half_z, is_round = housing[13], housing[14], housing[15], housing[16] > 0.0
    near, far = 0.0, math.inf
    if is_round:
        a, b = vx * vx + vy * vy, px * vx + py * vy
        c = px * px + py * py - half_x * half_x
        square = b * b - a * c
        if a > 0.0:
            if square <= 0.0:
                return math.inf
            root = math.sqrt(square)
            near, far = max(near, (-b - root) / a), min(far, (-b + root) / a)
        elif c >= 0.0:
            return math.inf
    for axis in range(2 if is_round else 0, 3):
        p = px if axis == 0 else py if axis == 1 else pz
        v = vx if axis == 0 else vy if axis == 1 else vz
        half = half_x if axis == 0 else half_y if axis == 1 else half_z
        if v == 0.0:
            if abs(p) >= half:
                return math.inf
        else:
            t0, t1 = (-half - p) / v, (half - p) / v
            near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    return near if near < far else math.inf


@njit(cache=True, nogil=True, error_model="numpy")
def behind_housing(origin, dx, dy, dz, reach, housings, own):
    """Whether the ray origin + t (dx, dy, dz) is inside a housing for some t in [0, reach).

    Args:
        housings: shape (n, COLUMNS).
        own: number of the LiDAR whose housing does not count.
    """
    for housing in housings:
        if housing[0] == own:
            continue
        ex, ey, ez = origin[0] - housing[1], origin[1] - housing[2], origin[2] - housing[3]
        r = housing[4:13]
        if (
            enter_housing(
                r[0] * ex + r[3] * ey + r[6] * ez,
                r[1] * ex + r[4] * ey + r[7] * ez,
                r[2] * ex + r[5] * ey + r[8] * ez,
                r[0] * dx + r[3] * dy + r[6] * dz,
                r[1] * dx + r[4] * dy + r[7] * dz,
                r[2] * dx + r[5] * dy + r[8] * dz,
                housing,
            )
            < reach
        ):
            return True
    return False

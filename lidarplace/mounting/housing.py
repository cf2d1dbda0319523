"""Housings of LiDARs, which hide what is behind them from the others of a rig.

A housing is a box around the origin of the sensor's frame and along its axes, or an upright
cylinder where length and width are equal. A LiDAR whose size is not known hides nothing."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

COLUMNS = 17
"""Columns of a housing: the number of its LiDAR, its origin, its rotation row by row, half its
length, width and height, and whether it is round; metres."""
NO_HOUSINGS = np.empty((0, COLUMNS))


def housings_of(mounts: Sequence[Mount], lidars: Sequence[Lidar]) -> NDArray[np.float64]:
    """Return the housings of the LiDARs of known size of a rig, shape (n, COLUMNS)."""
    rows = []
    for number, (mount, lidar) in enumerate(zip(mounts, lidars, strict=True)):
        if lidar.size is not None:
            length, width, height = lidar.size
            shape = 0.5 * length, 0.5 * width, 0.5 * height, length == width
            rows.append([number, *mount.position, *mount.rotation.ravel(), *shape])
    return np.array(rows, np.float64).reshape(-1, COLUMNS)


def housings_in(rig: Placement) -> NDArray[np.float64]:
    """Return the housings of a rig, its dead LiDARs behind the others, shape (n, COLUMNS)."""
    every = [*zip(rig.mounts, rig.lidars, strict=True), *rig.dead]
    return housings_of([mount for mount, _ in every], [lidar for _, lidar in every])


def as_housings(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return boxes (n, 2, 3), by lower and upper corners, as rows of housings of no LiDAR."""
    low, high, ones = boxes[:, 0], boxes[:, 1], np.ones((len(boxes), 1))
    parts = -ones, (low + high) / 2, ones * np.eye(3).ravel(), (high - low) / 2, 0 * ones
    return np.concatenate(parts, axis=1)


def without(housings: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """Return the housings of all LiDARs but one: what can hide the world from it."""
    return np.asarray(housings[housings[:, 0] != number])


def housing_around(rig: Placement, number: int) -> int | None:
    """Return the number of a LiDAR in whose housing LiDAR `number` is; None outside of all.

    Numbers are from 0, dead LiDARs after the others."""
    for housing in without(housings_in(rig), number):
        offset = rig.mounts[number].position - housing[1:4]
        along = np.abs(offset @ housing[4:13].reshape(3, 3))
        if housing[16]:
            along = np.array([math.hypot(*along[:2]), 0.0, along[2]])
        if (along < housing[13:16]).all():
            return int(housing[0])
    return None


@inner
def turned(rotation, x, y, z):
    """Return the vector (x, y, z), turned."""
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@inner
def enter_housing(px, py, pz, vx, vy, vz, housing):
    """Return the least t >= 0 at which a ray p + t v is inside a housing, in the housing's frame.

    0 for a ray that starts inside, inf for one that never is; a touch does not count."""
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


@inner
def behind_housing(origin, dx, dy, dz, reach, housings, lidar):
    """Return whether the ray origin + t (dx, dy, dz) is inside a housing for some t in [0, reach).

    The housing of LiDAR `lidar` does not count."""
    for n in range(len(housings)):
        housing = housings[n]
        if housing[0] == lidar:
            continue
        ex, ey, ez = origin[0] - housing[1], origin[1] - housing[2], origin[2] - housing[3]
        into = housing[4:13].reshape(3, 3).T
        px, py, pz = turned(into, ex, ey, ez)
        vx, vy, vz = turned(into, dx, dy, dz)
        if enter_housing(px, py, pz, vx, vy, vz, housing) < reach:
            return True
    return False

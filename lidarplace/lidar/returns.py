"""From first hits to the points that a LiDAR reports: drop-off, range noise, intensity."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

ATTENUATION = 0.004
"""Loss of intensity along the way, 1/m: the default of CARLA's LiDAR."""


@njit(cache=True)
def _mix(value):  # pragma: no cover - compiled
    """One step of splitmix64 (Steele, Lea and Flood, 2014)."""
    value = value + np.uint64(0x9E3779B97F4A7C15)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@njit(cache=True)
def _uniform(state):  # pragma: no cover - compiled
    """A number in (0, 1) from the upper 53 bits."""
    return (float(state >> np.uint64(11)) + 0.5) / 9007199254740992.0


@njit(cache=True)
def points_of(
    origin, directions, distance, hit, incidence, noise, drop_off, attenuation, crop, key
):
    """Points of one LiDAR in one frame, cut to `crop`.

    The random numbers of a ray depend on `key` and its index alone, so neither the order of the
    work nor the number of workers changes a point.

    Args:
        origin: position of the sensor, shape (3,).
        directions: of the rays, ego frame, shape (rays, 3).
        distance, hit, incidence: from `cast`; hits below -1 give no point.
        noise: standard deviation of the measured range, metres.
        drop_off: probability that a return is lost.
        attenuation: intensity is `exp(-attenuation * range) * cos(incidence)`.
        crop: lowest corner, then highest, shape (6,), metres.
        key: three integers (seed, frame, LiDAR) that name the random stream.

    Returns:
        x, y, z, intensity, shape (points, 4), float32.
    """
    points = np.empty((len(distance), 4), np.float32)
    size = 0
    stream = np.uint64(0)
    for part in key:
        stream = _mix(stream ^ np.uint64(part))
    for ray in range(len(distance)):
        if hit[ray] < -1:
            continue
        state = _mix(stream ^ np.uint64(ray))
        if drop_off > 0 and _uniform(state) < drop_off:
            continue
        measured = distance[ray]
        if noise > 0:  # Box and Muller
            second = _mix(state)
            radius = math.sqrt(-2 * math.log(_uniform(second)))
            measured += noise * radius * math.cos(2 * math.pi * _uniform(_mix(second)))
        x = origin[0] + measured * directions[ray, 0]
        y = origin[1] + measured * directions[ray, 1]
        z = origin[2] + measured * directions[ray, 2]
        if crop[0] <= x <= crop[3] and crop[1] <= y <= crop[4] and crop[2] <= z <= crop[5]:
            intensity = math.exp(-attenuation * distance[ray]) * incidence[ray]
            points[size] = x, y, z, intensity
            size += 1
    return points[:size].copy()

"""From hits to points: drop-off, range noise, intensity and the cut to a region.

Random numbers are counted, not drawn: each is a hash of seed, frame, LiDAR and ray. So a point
does not depend on which frames are collected with it, in which order or by how many workers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidarplace.lidar.raycast import Hits, beam_tables
from lidarplace.placement import Mount
from lidarplace.sensor import Lidar

ATTENUATION_PER_M = 0.004
"""Fall of the intensity with range, CARLA's default `atmosphere_attenuation_rate`."""

LARGEST_ERROR = 8.6
"""No range errs by more standard deviations: sqrt(-2 ln 2**-53) is 8.57."""


def sample_points(
    mount: Mount,
    lidar: Lidar,
    hits: Hits,
    crop: Sequence[float],
    key: tuple[int, int, int],
    points: NDArray[np.float32],
) -> int:
    """Write the points that one LiDAR returns from within `crop`; return their number.

    A return is lost with probability `lidar.drop_off`; its range errs by a normal of standard
    deviation `lidar.range_noise`, along the ray. Intensity is
    `cos(incidence) * exp(-ATTENUATION_PER_M * range)`, within [0, 1]. Own body returns nothing.

    Args:
        mount, lidar: as cast.
        hits: from `lidarplace.lidar.raycast.cast`.
        crop: x0, y0, z0, x1, y1, z1 in the ego frame, metres; the faces belong to it.
        key: seed, frame and index of the LiDAR; decides drop-off and noise together with the ray.
        points: x, y, z, intensity go to its first rows, in the order of the rays; float32, shape
            (n, 4) with n at least the number of rays.
    """
    return _sample(
        mount.position,
        mount.rotation,
        *beam_tables(lidar),
        np.array(crop, np.float64),
        LARGEST_ERROR * lidar.range_noise,
        hits.range,
        hits.target,
        hits.incidence,
        lidar.range_noise,
        lidar.drop_off,
        np.array([value % 2**64 for value in key], np.uint64),
        ATTENUATION_PER_M,
        points,
    )


@njit(cache=True)
def _mix(state):
    """Output function of splitmix64 (Steele, Lea, Flood 2014): a bijection that scatters bits."""
    z = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True)
def _uniform(stream, counter):
    """The `counter`-th number in (0, 1] of a splitmix64 stream, a multiple of 2**-53."""
    bits = _mix(stream + (counter + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15))
    return ((bits >> np.uint64(11)) + np.uint64(1)) * 2.0**-53


@njit(cache=True)
def _normal(stream, counter):
    """Standard normal from the numbers `counter` and `counter + 1` (Box and Muller)."""
    return math.sqrt(-2.0 * math.log(_uniform(stream, counter))) * math.cos(
        2.0 * math.pi * _uniform(stream, counter + np.uint64(1))
    )


@njit(cache=True)
def _sample(
    origin,
    rotation,
    elevations,
    azimuths,
    crop,
    slack,
    ranges,
    targets,
    incidences,
    range_noise,
    drop_off,
    key,
    attenuation,
    points,
):
    """Write the returns within `crop` to `points` and return their number."""
    stream = np.uint64(0)
    for part in key:
        stream = _mix((stream ^ part) + np.uint64(0x9E3779B97F4A7C15))
    steps = len(azimuths)
    count = 0
    for beam in range(len(elevations)):
        ce, se = elevations[beam, 1], elevations[beam, 2]
        for step in range(steps):
            ray = beam * steps + step
            if targets[ray] < -1:
                continue
            x, y = ce * azimuths[step, 0], ce * azimuths[step, 1]
            dx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * se
            dy = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * se
            dz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * se
            px = origin[0] + ranges[ray] * dx
            py = origin[1] + ranges[ray] * dy
            # Rounding must not push the ground out of a crop that starts at z = 0.
            pz = 0.0 if targets[ray] == -1 else origin[2] + ranges[ray] * dz
            if not (
                crop[0] - slack <= px <= crop[3] + slack
                and crop[1] - slack <= py <= crop[4] + slack
                and crop[2] - slack <= pz <= crop[5] + slack
            ):
                continue
            counter = np.uint64(3) * np.uint64(ray)
            if drop_off > 0.0 and _uniform(stream, counter) <= drop_off:
                continue
            distance = ranges[ray]
            if range_noise > 0.0:
                error = range_noise * _normal(stream, counter + np.uint64(1))
                error = max(error, -distance)
                distance += error
                px, py, pz = px + error * dx, py + error * dy, pz + error * dz
                if not (
                    crop[0] <= px <= crop[3]
                    and crop[1] <= py <= crop[4]
                    and crop[2] <= pz <= crop[5]
                ):
                    continue
            points[count, 0] = px
            points[count, 1] = py
            points[count, 2] = pz
            points[count, 3] = incidences[ray] * math.exp(-attenuation * distance)
            count += 1
    return count

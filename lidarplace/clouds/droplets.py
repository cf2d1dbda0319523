"""Drops of fog and rain near a LiDAR return light themselves: points where nothing is.

Along a ray the first drop whose light may come back is met as by Poisson's process, at the rate of
the extinction. It makes a point in place of what is behind it if it is near enough for the light of
drops to be noticed. Beyond, fog only dims."""

import math

import numpy as np

from lidarplace.base.kernel_cache import njit
from lidarplace.clouds.hashed import key_of, stream_of, uniform
from lidarplace.clouds.raycast import Hits
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.weather import shortened

LIDAR_RATIO = 18.8
"""Extinction over backscatter of drops of water at 905 nm, sr (O'Connor, Illingworth and Hogan
2004, J. Atmos. Ocean. Technol. 21, 777)."""
PULSE_M = 0.75
"""Depth of air that answers at once, metres: half the length of a pulse of 5 ns, our assumption."""
DROPS = 2**31 - 1
"""Target of a ray that drops send back: beyond the rows of all objects."""


def drop_reflectivity(extinction: float) -> float:
    """Return the reflectivity of a wall that sends back as much as the drops within a pulse.

    It is pi backscatter length, at most 1, by the extinction, 1/m."""
    return min(1.0, math.pi * extinction / LIDAR_RATIO * PULSE_M)


def sight_of_drops(lidar: Lidar) -> float:
    """Return the range within which a LiDAR notices drops, metres.

    If `range_10` is not known, it is that of a LiDAR that sees white up to `range`."""
    reflected = drop_reflectivity(lidar.extinction)
    if lidar.range_10 is not None:
        return float(lidar.sight(reflected))
    return float(shortened(lidar.range * lidar.window * math.sqrt(reflected), lidar.fading))


def scatter_back(lidar: Lidar, hits: Hits, key: tuple[int, int, int]) -> None:
    """Let rays end at drops, in place; nearer than `lidar.min_range` none is noticed.

    `key` as of `lidarplace.clouds.returns.sample_points`, whose random numbers are others."""
    if lidar.extinction > 0.0:
        interval = np.array([lidar.min_range, sight_of_drops(lidar)])
        reflected = drop_reflectivity(lidar.extinction)
        _scatter(hits, interval, lidar.extinction, reflected, key_of(*key))


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter(hits, interval, extinction, light, key) -> None:
    ranges, targets, reflected = hits
    stream = stream_of(key)
    for ray in range(len(ranges)):
        number = uniform(stream, np.uint64(2 * len(ranges) + ray))
        distance = interval[0] - math.log(number) / extinction
        if distance < interval[1] and distance < ranges[ray]:
            ranges[ray], targets[ray], reflected[ray] = distance, DROPS, light

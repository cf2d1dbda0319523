"""CARLA's ray-cast sensors: what a file says of them, and what a server is asked for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidarplace.rigs.lidar import Lidar
from lidarplace.scenes.routes import STEP_S

BLUEPRINT = "sensor.lidar.ray_cast"

UNEVEN = 1e-6
"""Radians by which a beam may miss its place in an even fan; CARLA computes in float32."""


@dataclass(frozen=True)
class Fan:
    """Beams at even distances, which is what one CARLA sensor can have; radians."""

    lower: float
    upper: float
    beams: int


def even_fans(elevations: Sequence[float]) -> list[Fan]:
    """The beam table as few fans as a greedy search finds, from the lowest beam up.

    CARLA spreads the channels of a sensor evenly between two elevations, so an even table is one
    fan; any other one is made of several sensors in one place.
    """
    table = np.sort(np.asarray(elevations, np.float64))
    fans, first = [], 0
    for end in range(1, len(table) + 1):
        run = table[first : end + 1]
        if end < len(table) and np.abs(run - np.linspace(run[0], run[-1], len(run))).max() < UNEVEN:
            continue
        fans.append(Fan(float(table[first]), float(table[end - 1]), end - first))
        first = end
    return fans


def attributes(lidar: Lidar, fan: Fan, seed: int) -> dict[str, str]:
    """Attributes of the sensor that fires `fan`, one full turn a step, without CARLA's own losses.

    CARLA drops returns at random, in general and by intensity, unless it is told not to.
    """
    values: dict[str, int | float] = {
        "channels": fan.beams,
        "lower_fov": math.degrees(fan.lower),
        "upper_fov": math.degrees(fan.upper),
        "range": lidar.reach,
        "points_per_second": round(fan.beams * lidar.azimuth_steps / STEP_S),
        "rotation_frequency": 1 / STEP_S,
        "dropoff_general_rate": lidar.drop_off,
        "dropoff_zero_intensity": 0.0,
        "noise_stddev": lidar.range_noise,
        "noise_seed": seed % 2**31,
    }
    return {n: str(v) if isinstance(v, int) else f"{v:.9g}" for n, v in values.items()}

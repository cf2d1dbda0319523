"""What a LiDAR meets of a building: its walls, and a sign on two of them.

Wall and sign are drawn from a hash of seed and place, so a building looks the same in every run
through its town.
"""

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.reflectivity import Material, reflectivity, uniforms
from lidarplace.clouds.shapes import BUILDING, SIGN, Parts, bricks

SIGN_M = 0.6
"""Edge of a sign, one in front of a building and one behind it."""

SIGN_HEIGHT_M = (1.0, 3.0)
"""Bottom of a sign above that of the building."""

_PROUD_M = 0.05  # how far a sign stands out of the wall


def facades(buildings: NDArray[np.float64], seed: int) -> Parts:
    """Parts of buildings, rows of `GEOMETRY` in the world, shape (B, 7).

    Signs front and back are one bar across the building, of which only the ends stand out.
    """
    number = len(buildings)
    drawn = [uniforms(f"{seed}/{x:.2f}/{y:.2f}", 4, b"facade") for x, y in buildings[:, :2]]
    wall, sign, along, up = np.array(drawn).reshape(number, 4).T
    low, high = SIGN_HEIGHT_M
    x, y, z, length, width, height, yaw = buildings.T
    edge, tall = np.minimum(SIGN_M, length), np.minimum(SIGN_M, height)
    aside = (along - 0.5) * (length - edge)
    bottom = np.minimum(low + (high - low) * up, height - tall)
    x, y, z = x + np.cos(yaw) * aside, y + np.sin(yaw) * aside, z - height / 2 + bottom + tall / 2
    signs = np.stack([x, y, z, edge, width + 2 * _PROUD_M, tall, yaw], axis=1)
    light = reflectivity(np.full(number, Material.RETROREFLECTOR), sign)
    walls = bricks(buildings, BUILDING, reflectivity(np.full(number, Material.WALL), wall))
    return walls.and_(bricks(signs, SIGN, light))

"""CARLA's left-handed coordinates, as arrays, into our right-handed ones."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarplace.rigs.pose import from_carla

Array = NDArray[np.float64]


def right_handed(
    position: NDArray[np.floating], degrees: NDArray[np.floating]
) -> tuple[Array, Array]:
    """`lidarplace.rigs.pose.from_carla` on arrays.

    Args:
        position: x, y, z, shape (N, 3), metres.
        degrees: roll, pitch, yaw, shape (N, 3).

    Returns:
        Positions (N, 3) in metres and angles (N, 3) in radians, float64.
    """
    convert: Any = from_carla  # written for numbers, but its arithmetic is elementwise
    pose = convert(*position.T.astype(np.float64), *np.radians(degrees.T.astype(np.float64)))
    return np.stack(pose[:3], axis=1), np.stack(pose[3:], axis=1)

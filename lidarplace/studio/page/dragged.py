"""Which coordinates of a LiDAR a person has changed by pulling at its handle."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.rigs.placement import Mount
from lidarplace.studio.rig import ANGLES, POSE

STEPS = dict.fromkeys(POSE[:3], 0.001) | dict.fromkeys(ANGLES, 0.1)
"""What a pull is rounded to, and of a number field: metres and degrees."""


def quaternion(mount: Mount) -> NDArray[np.float64]:
    """Sensor-to-ego rotation, w first, shape (4,)."""
    return np.asarray(Rotation.from_matrix(mount.rotation).as_quat(scalar_first=True))


def dragged(
    before: Mapping[str, float], position: NDArray[np.float64], wxyz: NDArray[np.float64]
) -> dict[str, float]:
    """Coordinates that differ from `before` by more than half a step, rounded to steps.

    What was not touched is left out, so that it stays as its file has it: also an angle that could
    be written as another, as 180 degrees and -180.

    Args:
        before: all of `POSE`, metres and degrees.
        position: metres, shape (3,).
        wxyz: sensor-to-ego rotation, shape (4,).
    """
    turned = Rotation.from_quat(wxyz, scalar_first=True)
    old = Rotation.from_euler("ZYX", [before[name] for name in reversed(ANGLES)], degrees=True)
    now = dict(zip(POSE[:3], position.tolist(), strict=True))
    if math.degrees((turned * old.inv()).magnitude()) > 0.5 * STEPS["yaw"]:
        angles = turned.as_euler("ZYX", degrees=True).tolist()
        now |= dict(zip(reversed(ANGLES), angles, strict=True))
    return {
        name: round(round(value / STEPS[name]) * STEPS[name], 6)
        for name, value in now.items()
        if abs(_apart(name, value, before[name])) > 0.5 * STEPS[name]
    }


def _apart(name: str, one: float, other: float) -> float:
    return math.remainder(one - other, 360) if name in ANGLES else one - other

"""Rotations between the sensor's and the ego frame, and CARLA's convention."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def rotation(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """Return the sensor-to-ego rotation `Rz(yaw) Ry(pitch) Rx(roll)`, shape (3, 3), of radians.

    Right-handed frames: pitch > 0 tips the nose down, roll > 0 lifts the left side."""
    cr, sr = np.cos(roll), np.sin(roll)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def angles(matrix: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a rotation of shape (3, 3), radians: the inverse of `rotation`.

    Pitch is within a quarter of a turn. Straight up or down roll and yaw turn about the same axis:
    whatever yaw is then, roll is what it leaves of the rotation, so the matrix is the same."""
    yaw = np.arctan2(matrix[1, 0], matrix[0, 0])
    pitch = np.arctan2(-matrix[2, 0], np.hypot(matrix[0, 0], matrix[1, 0]))
    sine, cosine = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(
        sine * matrix[0, 2] - cosine * matrix[1, 2], cosine * matrix[1, 1] - sine * matrix[0, 1]
    )
    return float(roll), float(pitch), float(yaw)


def from_carla(
    x: float, y: float, z: float, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0
) -> tuple[float, float, float, float, float, float]:
    """Convert a pose from CARLA's convention to ours, metres and radians in and out.

    CARLA is left-handed, y to the right, pitch > 0 lifts the nose. Mirroring y turns the sense
    of pitch and yaw; roll keeps its sign. The map is its own inverse."""
    # 0 - v, not -v: a zero stays +0, so that equal poses print and hash alike.
    return x, 0 - y, z, roll, 0 - pitch, 0 - yaw

"""Angles that look like degrees, and sizes that look like centimetres or millimetres."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lidarplace.box_log import BoxLog
from lidarplace.boxes import SIZE
from lidarplace.scenes.doubts.doubt import Doubt

MOST_YAW = 4 * math.pi
MOST_SIZE_M = 50.0
LEAST_WHOLE = 3
"""So many turned boxes, all by whole numbers of radians, are no chance."""


def doubts_of_units(log: BoxLog) -> Iterator[Doubt]:
    """Doubts of yaw and size, box by box."""
    yaw = log.boxes["yaw"].to_numpy(np.float64)
    far, turned = np.abs(yaw) > MOST_YAW, yaw != 0
    if far.any():
        yield Doubt("yaw", "yaw", far, "yaw is in radians; over two turns", "units.angle")
    elif turned.sum() >= LEAST_WHOLE and (yaw[turned] % 1 == 0).all():
        why = "yaw is in radians; all are whole numbers, as of degrees"
        yield Doubt("yaw", "yaw", turned, why, "units.angle")
    large = (log.boxes[list(SIZE)].max(axis=1) > MOST_SIZE_M).to_numpy()
    if large.any():
        why = f"sizes are in metres; over {MOST_SIZE_M:g} m"
        yield Doubt("size", SIZE[0], large, why, "units.size")

"""Angles that look like degrees, and sizes that look like centimetres or millimetres."""

import math
from collections.abc import Iterator

import numpy as np

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import SIZE
from lidarplace.logs.plausible import MOST_SIZE_M, MOST_YAW
from lidarplace.scenes.sanity_checks.doubt import Doubt

LEAST_WHOLE = 3
"""So many turned boxes, all by whole numbers of radians, are no chance."""
LEAST_BOXES = 20
"""So many come close to a full turn."""


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


def doubts_of_degrees(log: BoxLog) -> Iterator[Doubt]:
    """Doubt of a yaw that was read as degrees: it ends at pi, or 2 pi, where radians end."""
    ends = np.radians([math.pi, 2 * math.pi])
    largest = log.boxes["yaw"].abs().max()
    if len(log.boxes) >= LEAST_BOXES and ((0.97 * ends < largest) & (largest <= ends)).any():
        why = f"yaw ends at {math.degrees(largest):.2f} degrees, where radians end"
        yield Doubt("yaw", "yaw", np.ones(len(log.boxes), bool), why, "units.angle: rad")

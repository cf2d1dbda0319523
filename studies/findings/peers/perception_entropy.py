"""Perception entropy (Ma, Liu and Li, 2021, arXiv 2104.06615), for LiDARs.

An object with m points is found with AP = a ln m + b, within [0.001, 0.999]. Its position is then
normal with sigma = 1 / AP - 1 along both axes, of entropy 2 ln sigma + 1 + ln 2 pi. Points of all
LiDARs are fused early: m is their sum. a and b are those of the LiDAR detector of the paper, as
they stand in public implementations of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidarplace.logs.box_log import BoxLog
from lidarplace.rigs.placement import Placement
from peers.seen_objects import by_class, seen_objects

SLOPE, OFFSET = 0.152, 0.659
LEAST_AP, MOST_AP = 0.001, 0.999


def perception_entropy(placement: Placement, log: BoxLog) -> dict[str, float]:
    """The mean over the objects with the other sign, nats: high for good rigs."""
    objects, seen = seen_objects(placement, log)
    table = objects.table[["class"]].assign(entropy=entropy(seen.points))
    return by_class(table, lambda own: -float(own["entropy"].mean()))


def entropy(points: ArrayLike) -> NDArray[np.float64]:
    """Of an object with so many points, nats; any shape."""
    number = np.asarray(points, np.float64)
    ap = SLOPE * np.log(np.maximum(number, 1.0)) + OFFSET
    ap = np.clip(np.where(number > 0, ap, 0.0), LEAST_AP, MOST_AP)
    return np.asarray(2 * np.log(1 / ap - 1) + 1 + np.log(2 * np.pi))

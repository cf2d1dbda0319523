"""Roll, pitch and yaw that the zones of a studio's file allow."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidarplace.studio.rig import ANGLES
from lidarplace.studio.rigs_file import RigsFile

ROUNDING_DEG = 0.01
"""Angles of a search are rounded by less."""


def allowed_turns(file: RigsFile, zone: str, model: str | None, y: float) -> NDArray[np.float64]:
    """Return middle and half width of each range, degrees, shape (3, 2); infinite without bounds.

    At a position `y` right of a mirrored zone, roll and yaw have the other sign. Without such a
    zone there are no bounds."""
    turns = np.tile([0.0, math.inf], (3, 1))
    if (settings := file.settings.zones.get(zone)) is None:
        return turns
    sources = [*filter(None, [(settings.models or {}).get(model or "")]), settings]
    for row, angle in enumerate(ANGLES):
        spans = (getattr(source, f"{angle}_deg") for source in sources)
        if (span := next((span for span in spans if span is not None), None)) is not None:
            turns[row] = sum(span) / 2, (span[1] - span[0]) / 2
            turns[row, 0] += settings.facing_deg * (angle == "yaw")
    if settings.mirrored and y < 0:
        turns[[0, 2], 0] *= -1
    return turns


def beyond(
    angles: Sequence[float] | NDArray[np.float64], turns: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far angles, degrees, are from `allowed_turns`, with a sign, shape (3,)."""
    centre, half = turns.T
    off = (np.asarray(angles) - centre + 180) % 360 - 180
    return np.asarray(off - np.clip(off, -half, half))

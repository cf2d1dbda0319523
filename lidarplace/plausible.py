"""Boxes that are finite and yet cannot be meant: other units than metres and radians."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

LARGEST_M = 100.0
"""No vehicle is so long; 4.5 m in centimetres is more."""
TURN = 2 * math.pi + 1e-6


def implausible(boxes: pd.DataFrame) -> Iterator[str]:
    """What looks wrong, with the share of rows that it concerns; nothing if all can be meant.

    Args:
        boxes: with the columns of `lidarplace.boxes.GEOMETRY`, finite.
    """
    sizes = boxes[["length", "width", "height"]].to_numpy(np.float64)
    too_large = (sizes > LARGEST_M).any(axis=1)
    turned = np.abs(boxes["yaw"].to_numpy(np.float64)) > TURN
    for rows, found, hint in (
        (too_large, f"larger than {LARGEST_M:g} m", "sizes are metres; are these millimetres?"),
        (turned, "turned by more than 2 pi", "yaw is in radians; are these degrees?"),
    ):
        if rows.any():
            yield (
                f"{rows.sum():,} of {len(boxes):,} boxes ({rows.mean():.0%}) are {found}, the "
                f"first in row {int(rows.argmax())}: {hint}"
            )

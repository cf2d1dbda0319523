"""Which boxes can be meant: beyond these limits they look like other units."""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.logs.boxes import first

MOST_SIZE_M = 50.0  # hardly a vehicle is so long; 4.5 m in centimetres is more
MOST_YAW = 4 * math.pi
"""A yaw that was unwrapped may pass a turn; most directions in degrees are more."""
SIZES = (30.0, 1000.0)  # median longest side from which a box is in centimetres, and in millimetres
STEP_S = (0.008, 15.0)  # from one labelled frame to the next, in the median


def implausible(boxes: pd.DataFrame) -> Iterator[str]:
    """What looks wrong in boxes (finite `GEOMETRY`), and in which share of rows."""
    sizes = boxes[["length", "width", "height"]].to_numpy(np.float64)
    too_large = (sizes > MOST_SIZE_M).any(axis=1)
    longest = np.median(sizes[too_large].max(axis=1)) if too_large.any() else 0.0
    unit = "centimetres" if longest < SIZES[1] else "millimetres"
    turned = np.abs(boxes["yaw"].to_numpy(np.float64)) > MOST_YAW
    for rows, found, hint in (
        (too_large, f"larger than {MOST_SIZE_M:g} m", f"sizes are metres; are these {unit}?"),
        (turned, "turned by more than two turns", "yaw is in radians; are these degrees?"),
    ):
        if rows.any():
            yield (
                f"{rows.sum():,} of {len(boxes):,} boxes ({rows.mean():.0%}) are {found}, the "
                f"first in row {int(rows.argmax())}: {hint}"
            )


def check_yaw(yaw: pd.Series, source: str) -> None:
    """Raise ValueError if a finite yaw is over two turns: it is in degrees, or nonsense."""
    if (row := first(np.abs(yaw.to_numpy(np.float64)) > MOST_YAW)) is not None:
        place, key, found = f"{source}: row {row}", str(yaw.name), f"{yaw.iloc[row]:g}"
        expected, fix = "radians, at most two turns", "numpy.radians converts degrees"
        raise InputError(place=place, key=key, expected=expected, found=found, fix=fix)

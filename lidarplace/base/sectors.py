"""Sectors around the vehicle, by which objects are grouped by direction."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

SECTORS = ("front", "front left", "left", "rear left", "rear", "rear right", "right", "front right")
"""Names by number, counterclockwise from above. The first has the x axis in its middle."""

WIDTH_DEG = 360 / len(SECTORS)


def sector_of(boxes: pd.DataFrame) -> NDArray[np.int64]:
    """Return the number of the sector that holds the centre of each box, from 0; shape (rows,).

    A sector holds its first bound, counterclockwise. Directly above the origin it is the front."""
    azimuth = np.degrees(np.arctan2(boxes["y"].to_numpy(np.float64), boxes["x"]))
    return np.asarray(np.floor(azimuth / WIDTH_DEG + 0.5), np.int64) % len(SECTORS)


def bounds_of(sector: int) -> tuple[float, float]:
    """Return the azimuths of the ends of a sector, degrees from the x axis to the left, >= -180."""
    centre = (sector * WIDTH_DEG + 180) % 360 - 180
    return centre - WIDTH_DEG / 2, centre + WIDTH_DEG / 2

"""Rings around the vehicle, by which objects are grouped by distance."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

EDGES_M = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, np.inf)
"""Bounds of the rings in metres. A ring holds its lower bound."""


def ring_of(boxes: pd.DataFrame) -> NDArray[np.int64]:
    """Return the number of the ring that holds the centre of each box, whatever its z; (rows,)."""
    distance = np.hypot(boxes["x"].to_numpy(np.float64), boxes["y"].to_numpy(np.float64))
    return np.asarray(np.digitize(distance, EDGES_M[1:-1]))


def bounds_of(ring: int) -> tuple[float, float]:
    """Return lower and upper bound of a ring in metres."""
    return EDGES_M[ring], EDGES_M[ring + 1]

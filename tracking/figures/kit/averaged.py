"""Maps made small enough for a page that holds many."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.roi import Interval


def averaged(
    cells: NDArray[np.float32], sides: tuple[Interval, Interval], most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Means over blocks of cells.

    Args:
        cells: shape (n, m).
        sides: what the map spans along both axes, metres.
        most: the blocks are square, and so large that no axis has more than these.

    Returns:
        The means, and the edges of the blocks along both axes in metres.
    """
    step = -(-max(cells.shape) // most)
    means = cells.astype(np.float64)
    edges = []
    for axis, (low, high) in enumerate(sides):
        n = cells.shape[axis]
        starts = np.arange(0, n, step)
        size = np.diff(np.append(starts, n))
        means = np.add.reduceat(means, starts, axis=axis)
        means /= size[:, None] if axis == 0 else size
        edges.append(low + (high - low) / n * np.append(starts, n))
    return means, edges[0], edges[1]

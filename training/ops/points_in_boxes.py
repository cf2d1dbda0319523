"""Count the points inside rotated boxes."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray


@njit(cache=True)
def _count_kernel(points, boxes):
    counts = np.zeros(len(boxes), np.int64)
    for b in range(len(boxes)):
        x, y, z = boxes[b, 0], boxes[b, 1], boxes[b, 2]
        half_length, half_width, half_height = (
            0.5 * boxes[b, 3],
            0.5 * boxes[b, 4],
            0.5 * boxes[b, 5],
        )
        cos, sin = math.cos(boxes[b, 6]), math.sin(boxes[b, 6])
        for i in range(len(points)):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            if (
                abs(cos * dx + sin * dy) <= half_length
                and abs(cos * dy - sin * dx) <= half_width
                and abs(points[i, 2] - z) <= half_height
            ):
                counts[b] += 1
    return counts


def count_points(points: ArrayLike, boxes: ArrayLike) -> NDArray[np.int64]:
    """Number of `points` (N, 3 or more) in each of `boxes` (M, 7), shape (M,).

    Same frame, metres and radians; a point on the surface is inside.
    """
    return _count_kernel(np.asarray(points), np.asarray(boxes, np.float64))

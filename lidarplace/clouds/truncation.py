"""Truncation: the share of an object outside of a region, seen from above."""

import math

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.base.roi import Interval
from lidarplace.mounting.slices import clip


def truncation(boxes: NDArray[np.float64], x: Interval, y: Interval) -> NDArray[np.float64]:
    """Return the share of the footprint of each box outside the rectangle x, y; (B,), in [0, 1].

    Exact: the footprint is clipped as a polygon (Sutherland and Hodgman 1974). One without an area
    counts as its centre. Boxes are rows of `lidarplace.logs.boxes.GEOMETRY`, shape (B, 7), in the
    frame of the rectangle, whose edges belong to it."""
    return _truncation(np.require(boxes, np.float64, ["C", "W"]), (*x, *y))


@njit(cache=True, error_model="numpy")
def _truncation(boxes, bounds) -> NDArray[np.float64]:
    share = np.empty(len(boxes))
    polygon, clipped = np.empty((8, 2)), np.empty((8, 2))
    for b in range(len(boxes)):
        box = boxes[b]
        whole = box[3] * box[4]
        if not whole > 0.0:
            inside = bounds[0] <= box[0] <= bounds[1] and bounds[2] <= box[1] <= bounds[3]
            share[b] = 0.0 if inside else 1.0
            continue
        c, s = math.cos(box[6]), math.sin(box[6])
        for n, (i, j) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            lx, ly = 0.5 * i * box[3], 0.5 * j * box[4]
            # Relative to the centre, so that areas far from the origin stay exact.
            polygon[n, 0], polygon[n, 1] = c * lx - s * ly, s * lx + c * ly
        number, cut = 4, False
        for edge in range(4):
            axis, sign = edge >> 1, -1.0 if edge & 1 else 1.0
            corners = clip(polygon, number, axis, sign, bounds[edge] - box[axis], clipped)
            cut |= corners != number or (clipped[:corners] != polygon[:corners]).any()
            polygon, clipped, number = clipped, polygon, corners
        area = 0.0
        for n in range(number):
            start, end = polygon[n], polygon[(n + 1) % number]
            area += 0.5 * (start[0] * end[1] - start[1] * end[0])
        # What no edge cuts lies inside or outside as a whole, without rounding.
        outside = 1.0 - area / whole if cut else (1.0 if number == 0 else 0.0)
        share[b] = min(max(outside, 0.0), 1.0)
    return share

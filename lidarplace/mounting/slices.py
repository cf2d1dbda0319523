"""Slices of triangles between two heights, from above, and the rectangles that meet them."""

import math

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit

_HAIR = 1e-9  # metres: a touch does not count
_MOST = 5  # corners of a triangle that two planes cut


def slices_of(
    triangles: NDArray[np.float64], low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the part of each triangle (T, 3, 3) between two heights, metres, seen from above.

    Corners x and y of convex polygons, shape (n, 5, 2), and how many each has, (n,), without
    triangles that have no such part. A box that stands upright between the heights meets a triangle
    if its rectangle meets that part."""
    heights = triangles[:, :, 2]
    some = (heights.min(axis=1) < high - _HAIR) & (heights.max(axis=1) > low + _HAIR)
    return _cut(np.ascontiguousarray(triangles[some]), low, high)


@inner
def clip(polygon, number, axis, sign, limit, clipped):
    """Write to `clipped` the corners of a polygon beyond a limit; return how many there are.

    Beyond is where `sign` times the coordinate on an axis is at least that of `limit`; `number` is
    that of the polygon's corners (Sutherland and Hodgman 1974)."""
    count = 0
    for n in range(number):
        corner, following = polygon[n], polygon[(n + 1) % number]
        margin, next_margin = sign * (corner[axis] - limit), sign * (following[axis] - limit)
        if margin >= 0.0:
            for c in range(clipped.shape[1]):
                clipped[count, c] = corner[c]
            count += 1
        if (margin > 0.0 and next_margin < 0.0) or (margin < 0.0 and next_margin > 0.0):
            for c in range(clipped.shape[1]):
                clipped[count, c] = corner[c] + margin / (margin - next_margin) * (
                    following[c] - corner[c]
                )
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _cut(triangles, low, high) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    polygons = np.zeros((len(triangles), _MOST, 2))
    corners = np.zeros(len(triangles), np.int64)
    before, after = np.empty((_MOST + 1, 3)), np.empty((_MOST + 1, 3))
    for t in range(len(triangles)):
        number = 3
        for n in range(3):
            for c in range(3):
                before[n, c] = triangles[t, n, c]
        for sign, height in ((1.0, low), (-1.0, high)):
            number = clip(before, number, 2, sign, height, after)
            before, after = after, before
        corners[t] = number
        for n in range(number):
            polygons[t, n, 0], polygons[t, n, 1] = before[n, 0], before[n, 1]
    return polygons, corners


@njit(cache=True, nogil=True, error_model="numpy")
def meets_slices(points, half_length, half_width, heading, polygons, corners):
    """Return whether the rectangle around each of points (P, 2) meets one of `slices_of`.

    Its length is along `heading`; a touch does not count."""
    c, s = math.cos(heading), math.sin(heading)
    # In the frame of the rectangles, where these are upright.
    turned = np.empty_like(polygons)
    bounds = np.empty((len(polygons), 4))
    for n in range(len(polygons)):
        bounds[n, :2], bounds[n, 2:] = np.inf, -np.inf
        for k in range(corners[n]):
            x, y = polygons[n, k]
            turned[n, k, 0], turned[n, k, 1] = c * x + s * y, c * y - s * x
            for axis in range(2):
                bounds[n, axis] = min(bounds[n, axis], turned[n, k, axis])
                bounds[n, axis + 2] = max(bounds[n, axis + 2], turned[n, k, axis])
    met = np.zeros(len(points), np.bool_)
    for p in range(len(points)):
        x, y = c * points[p, 0] + s * points[p, 1], c * points[p, 1] - s * points[p, 0]
        for n in range(len(polygons)):
            if (
                bounds[n, 0] < x + half_length - _HAIR
                and bounds[n, 2] > x - half_length + _HAIR
                and bounds[n, 1] < y + half_width - _HAIR
                and bounds[n, 3] > y - half_width + _HAIR
                and not _apart(turned[n], corners[n], x, y, half_length, half_width)
            ):
                met[p] = True
                break
    return met


@inner
def _apart(polygon, number, x, y, half_length, half_width):
    """Return whether a side of a convex polygon parts it from an upright rectangle."""
    for k in range(number):
        px, py = polygon[k]
        nx, ny = polygon[(k + 1) % number, 1] - py, px - polygon[(k + 1) % number, 0]
        length = math.hypot(nx, ny)
        if length == 0.0:
            continue
        low, high = np.inf, -np.inf
        for j in range(number):
            along = ((polygon[j, 0] - px) * nx + (polygon[j, 1] - py) * ny) / length
            low, high = min(low, along), max(high, along)
        centre = ((x - px) * nx + (y - py) * ny) / length
        reach = (abs(nx) * half_length + abs(ny) * half_width) / length
        if centre - reach >= high - _HAIR or centre + reach <= low + _HAIR:
            return True
    return False

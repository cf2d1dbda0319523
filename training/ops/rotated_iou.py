"""Exact overlap of boxes that are rotated about z."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import inner, njit


@inner
def _clip(polygon, count, axis, sign, limit, clipped):
    """Keep the part of a polygon with `sign * coordinate <= limit`; return its vertex count.

    Polygons have x and y of their vertices, (2, 8) or more. One step of I. Sutherland and
    G. Hodgman, Reentrant polygon clipping, 1974."""
    vertices = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        inside_i, inside_j = limit - sign * polygon[axis, i], limit - sign * polygon[axis, j]
        if inside_i >= 0:
            clipped[0, vertices], clipped[1, vertices] = polygon[0, i], polygon[1, i]
            vertices += 1
        if (inside_i > 0 and inside_j < 0) or (inside_i < 0 and inside_j > 0):
            t = inside_i / (inside_i - inside_j)
            for k in range(2):
                clipped[k, vertices] = polygon[k, i] + t * (polygon[k, j] - polygon[k, i])
            vertices += 1
    return vertices


@inner
def _bev_intersection(a, b, work):
    """Area common to two rotated rectangles; `work` is space for two polygons, see `_clip`.

    Works in the frame of `a`, so that far coordinates cost no digits and `a` is a plain interval
    in x and in y."""
    polygon, clipped = work[0], work[1]
    dx, dy = b[0] - a[0], b[1] - a[1]
    reach = math.hypot(a[3], a[4]) + math.hypot(b[3], b[4])
    if 4 * (dx * dx + dy * dy) > reach * reach:
        return 0.0
    cos_a, sin_a = math.cos(a[6]), math.sin(a[6])
    x = cos_a * dx + sin_a * dy
    y = cos_a * dy - sin_a * dx
    cos_b, sin_b = math.cos(b[6] - a[6]), math.sin(b[6] - a[6])
    for i in range(4):
        u = (0.5 if i == 0 or i == 3 else -0.5) * b[3]
        v = (0.5 if i < 2 else -0.5) * b[4]
        polygon[0, i] = x + cos_b * u - sin_b * v
        polygon[1, i] = y + sin_b * u + cos_b * v
    count = 4
    for axis in range(2):
        count = _clip(polygon, count, axis, 1.0, 0.5 * a[3 + axis], clipped)
        count = _clip(clipped, count, axis, -1.0, 0.5 * a[3 + axis], polygon)
    area, (xs, ys) = 0.0, (polygon[0], polygon[1])
    # A fan of triangles from vertex 0: small numbers, no cancellation.
    for i in range(1, count - 1):
        area += (xs[i] - xs[0]) * (ys[i + 1] - ys[0]) - (xs[i + 1] - xs[0]) * (ys[i] - ys[0])
    # Rounding must not make the common part larger than either box.
    return min(0.5 * abs(area), a[3] * a[4], b[3] * b[4])


@inner
def _iou(a, b, three_d, work):
    common = _bev_intersection(a, b, work)
    size_a, size_b = a[3] * a[4], b[3] * b[4]
    if three_d:
        top = min(a[2] + 0.5 * a[5], b[2] + 0.5 * b[5])
        bottom = max(a[2] - 0.5 * a[5], b[2] - 0.5 * b[5])
        size_a, size_b = size_a * a[5], size_b * b[5]
        common = min(common * max(0.0, top - bottom), size_a, size_b)
    union = size_a + size_b - common
    return common / union if union > 0 else 0.0


@njit(cache=True)
def _pair_kernel(a, b, three_d) -> NDArray[np.float64]:
    work = np.empty((2, 2, 16))
    out = np.empty(len(a))
    for i in range(len(a)):
        out[i] = _iou(a[i], b[i], three_d, work)
    return out


@njit(cache=True)
def _matrix_kernel(a, b, three_d) -> NDArray[np.float64]:
    work = np.empty((2, 2, 16))
    out = np.empty((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            out[i, j] = _iou(a[i], b[j], three_d, work)
    return out


@inner
def _could_exceed(a, b, cos_a, sin_a, cos_b, sin_b, threshold):
    """Test by the bounds of `b` along `a` if the IoU from above may be greater than `threshold`.

    No trigonometry and no clipping, and false for almost all pairs that do not exceed it."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    x, y = abs(cos_a * dx + sin_a * dy), abs(cos_a * dy - sin_a * dx)
    cos = abs(cos_a * cos_b + sin_a * sin_b)
    sin = abs(cos_a * sin_b - sin_a * cos_b)
    half_x, half_y = 0.5 * (cos * b[3] + sin * b[4]), 0.5 * (sin * b[3] + cos * b[4])
    wide = min(0.5 * a[3] + half_x - x, a[3], 2 * half_x)
    deep = min(0.5 * a[4] + half_y - y, a[4], 2 * half_y)
    if wide < 0 or deep < 0:
        return False
    size_a, size_b = a[3] * a[4], b[3] * b[4]
    common = min(wide * deep, size_a, size_b)
    # The slack is more than rounding may lose.
    return common * (1 + 1e-9) >= threshold * (size_a + size_b - common)


@njit(cache=True)
def _suppression_kernel(boxes, threshold, limit) -> NDArray[np.int64]:
    survivors = np.empty(min(len(boxes), limit), np.int64)
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    work = np.empty((2, 2, 16))
    count = 0
    for i in range(len(boxes)):
        if count == len(survivors):
            break
        for k in survivors[:count]:
            near = _could_exceed(boxes[k], boxes[i], cos[k], sin[k], cos[i], sin[i], threshold)
            if near and _iou(boxes[k], boxes[i], False, work) > threshold:
                break
        else:
            survivors[count] = i
            count += 1
    return survivors[:count]


def checked(boxes: ArrayLike) -> NDArray[np.float64]:
    """Return the boxes (N, 7) in float64; raises ValueError as `iou_bev` does."""
    array = np.require(boxes, np.float64, ["C", "W"])  # a read-only array would be another type
    if array.ndim != 2 or array.shape[1] != 7:
        raise InputError(key="boxes", expected="shape (N, 7), x to yaw", found=array.shape)
    if not np.isfinite(array).all():
        raise InputError(key="boxes", expected="finite numbers", found="NaN or infinity")
    if (array[:, 3:6] < 0).any():
        raise InputError(key="boxes", expected="sizes from 0", found=array[:, 3:6].min())
    return array


def iou_bev(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Intersection over union from above of boxes `a` (N, 7) and `b` (M, 7), shape (N, M).

    Two boxes without area have IoU 0.

    Raises ValueError for a wrong shape, a negative size or a value not finite."""
    return _matrix_kernel(checked(a), checked(b), False)


def iou_3d(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Intersection over union of volumes; arguments and errors as of `iou_bev`."""
    return _matrix_kernel(checked(a), checked(b), True)


def paired_iou(a: ArrayLike, b: ArrayLike, three_d: bool) -> NDArray[np.float64]:
    """IoU of row i of `a` (P, 7) with row i of `b` (P, 7), shape (P,), in 3D or from above.

    Raises ValueError as `iou_bev` does, and if the lengths differ."""
    a, b = checked(a), checked(b)
    if len(a) != len(b):
        raise InputError(key="b", expected=f"{len(a)} boxes, as in a", found=len(b))
    return _pair_kernel(a, b, three_d)


def unsuppressed(boxes: ArrayLike, threshold: float, limit: int) -> NDArray[np.int64]:
    """Rows of `boxes` (N, 7) that survive when each survivor removes later boxes that overlap it.

    A box is removed at an IoU from above greater than `threshold`, at least 0; at most `limit`
    survive."""
    return _suppression_kernel(checked(boxes), float(threshold), limit)

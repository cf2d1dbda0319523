"""Exact overlap of boxes that are rotated about z."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import inner, njit


@inner
def _bev_intersection(a, b, turn_a, turn_b):
    """Area common to two rotated rectangles whose turns are (cosine, sine), seen from above.

    By Green's theorem it is the integral of x dy along the edges of `b`, with x and y clamped to
    `a`, in the frame of `a`: far coordinates cost no digits, and edges that coincide need no rule.
    """
    half_x, half_y, along, across = 0.5 * a[3], 0.5 * a[4], 0.5 * b[3], 0.5 * b[4]
    dx, dy = b[0] - a[0], b[1] - a[1]
    x, y = turn_a[0] * dx + turn_a[1] * dy, turn_a[0] * dy - turn_a[1] * dx
    cos = turn_a[0] * turn_b[0] + turn_a[1] * turn_b[1]
    sin = turn_a[0] * turn_b[1] - turn_a[1] * turn_b[0]
    c, s = abs(cos), abs(sin)
    apart = (abs(x) >= half_x + c * along + s * across) | (
        abs(y) >= half_y + s * along + c * across
    )
    apart |= abs(cos * x + sin * y) >= along + c * half_x + s * half_y
    apart |= abs(cos * y - sin * x) >= across + s * half_x + c * half_y
    if apart:
        return 0.0
    area = 0.0
    for i in range(4):
        u, v = (along if i == 0 or i == 3 else -along), (across if i < 2 else -across)
        x0, y0 = x + cos * u - sin * v, y + sin * u + cos * v
        u, v = (-u, v) if i == 0 or i == 2 else (u, -v)
        x1, y1 = x + cos * u - sin * v, y + sin * u + cos * v
        # The part of the edge between the sides of `a` along x.
        low, high = min(max(y0, -half_y), half_y), min(max(y1, -half_y), half_y)
        span = y1 - y0 if y1 != y0 else 1.0
        left, right = x0 + (low - y0) / span * (x1 - x0), x0 + (high - y0) / span * (x1 - x0)
        # Mean of the clamped x over it: before the kink, between, behind.
        start, end = min(max(left, -half_x), half_x), min(max(right, -half_x), half_x)
        span = right - left if right != left else 1.0
        outside = ((start - left) - (right - end)) / span
        area += (high - low) * 0.5 * (start + end + outside * (start - end))
    # Rounding must not make the common part larger than either box.
    return min(max(area, 0.0), a[3] * a[4], b[3] * b[4])


@inner
def _iou(a, b, turn_a, turn_b, three_d):
    common = _bev_intersection(a, b, turn_a, turn_b)
    size_a, size_b = a[3] * a[4], b[3] * b[4]
    if three_d:
        top = min(a[2] + 0.5 * a[5], b[2] + 0.5 * b[5])
        bottom = max(a[2] - 0.5 * a[5], b[2] - 0.5 * b[5])
        size_a, size_b = size_a * a[5], size_b * b[5]
        common = min(common * max(0.0, top - bottom), size_a, size_b)
    union = size_a + size_b - common
    return common / union if union > 0 else 0.0


@inner
def _turn(box):
    return math.cos(box[6]), math.sin(box[6])


@njit(cache=True)
def _pair_kernel(a, b, three_d) -> NDArray[np.float64]:
    out = np.empty(len(a))
    for i in range(len(a)):
        out[i] = _iou(a[i], b[i], _turn(a[i]), _turn(b[i]), three_d)
    return out


@njit(cache=True)
def _matrix_kernel(a, b, three_d) -> NDArray[np.float64]:
    out = np.empty((len(a), len(b)))
    cos, sin = np.cos(b[:, 6]), np.sin(b[:, 6])
    for i in range(len(a)):
        turn = _turn(a[i])
        for j in range(len(b)):
            out[i, j] = _iou(a[i], b[j], turn, (cos[j], sin[j]), three_d)
    return out


@inner
def _could_exceed(a, b, turn_a, turn_b, threshold):
    """Test by the bounds of `b` along `a` if the IoU from above may be greater than `threshold`.

    It is false for almost all pairs that do not exceed it."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    x, y = abs(turn_a[0] * dx + turn_a[1] * dy), abs(turn_a[0] * dy - turn_a[1] * dx)
    cos = abs(turn_a[0] * turn_b[0] + turn_a[1] * turn_b[1])
    sin = abs(turn_a[0] * turn_b[1] - turn_a[1] * turn_b[0])
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
    count = 0
    for i in range(len(boxes)):
        if count == len(survivors):
            break
        turn = cos[i], sin[i]
        for k in survivors[:count]:
            near = _could_exceed(boxes[k], boxes[i], (cos[k], sin[k]), turn, threshold)
            if near and _iou(boxes[k], boxes[i], (cos[k], sin[k]), turn, False) > threshold:
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

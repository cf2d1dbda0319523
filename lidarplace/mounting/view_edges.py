"""Edges of the view of a sensor, and the points where a circle crosses them."""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner
from lidarplace.mounting.field_of_view import View
from lidarplace.mounting.housing import as_housings, without
from lidarplace.mounting.sight import Obstacles

_RIDGES = np.array([(i, j) for i, j in combinations(range(6), 2) if j != i + 3]).T
"""The edges of a box by the numbers of their two faces; faces i and i + 3 are opposite."""
_MOST = 9  # planes around a shadow: three faces and six ridges
_NO_PLANE = 0.0, 0.0, 0.0, 1.0
_MOST_OF_CONE = 8  # crossings of a circle; four but for rounding
_STEP = 1e-3  # radians of a circle, in which an edge is not crossed twice
_HAIR = 1e-9


class Edges(NamedTuple):
    """Surfaces where the view of a sensor ends, in the vehicle's frame.

    Attributes:
        field: of the field of view. A row (n, k, s) is the surface n p + k = s |p - origin|: a
            plane, a cone or a sphere; shape (F, 5).
        shadows: of each convex obstacle the planes around what it hides, n p + k >= 0 inside;
            shape (K, 9, 4)."""

    field: NDArray[np.float64]
    shadows: NDArray[np.float64]


def edges_of(view: View, obstacles: Obstacles, number: int) -> Edges:
    """Return the edges of a view without those of meshes.

    The housing of LiDAR `number` hides nothing; a round one is taken for the two boxes around it,
    one of them turned by 45 degrees."""
    return Edges(_field(view), _shadows(view.origin, obstacles, number))


def _field(view: View) -> NDArray[np.float64]:
    field = view.field
    start, width = field.azimuth
    ends = [] if width >= 2 * math.pi else [start, start + width]
    rows = [(-math.sin(end), math.cos(end), 0.0, 0.0, 0.0) for end in ends]
    rows += [(0.0, 0.0, 1.0, 0.0, sine) for sine in field.sines if abs(sine) < 1]
    if field.cosine > -1:
        rows.append((1.0, 0.0, 0.0, 0.0, field.cosine))
    if field.slopes[0] < math.inf:
        left, right, up, down = field.slopes
        rows += [(left, -1.0, 0.0, 0.0, 0.0), (right, 1.0, 0.0, 0.0, 0.0)]
        rows += [(up, 0.0, -1.0, 0.0, 0.0), (down, 0.0, 1.0, 0.0, 0.0)]
    if field.reach < math.inf:
        rows.append((0.0, 0.0, 0.0, field.reach, 1.0))
    edges = np.array(rows).reshape(-1, 5)
    edges[:, :3] = edges[:, :3] @ view.rotation.T
    edges[:, 3] -= edges[:, :3] @ view.origin
    return edges


def _shadows(origin: NDArray[np.float64], obstacles: Obstacles, number: int) -> NDArray[np.float64]:
    boxes = np.concatenate([as_housings(obstacles.boxes), without(obstacles.housings, number)])
    axes, half = boxes[:, 4:13].reshape(-1, 3, 3).transpose(0, 2, 1), math.sqrt(0.5)
    octagon = np.array([[half, half, 0.0], [-half, half, 0.0], [0.0, 0.0, 1.0]])
    is_round = boxes[:, 16] > 0
    axes = np.concatenate([axes, octagon @ axes[is_round]])
    boxes = np.concatenate([boxes, boxes[is_round]])
    inwards = np.concatenate([-axes, axes], axis=1)
    offsets = np.tile(boxes[:, 13:16], 2) - (inwards @ boxes[:, 1:4, None])[..., 0]
    faces = np.concatenate([inwards, offsets[..., None]], axis=2)
    away = (inwards @ origin) + offsets
    visible, (i, j) = away < 0, _RIDGES
    # The plane through the origin and the ridge between a visible face and a hidden one.
    ridges = np.abs(away[:, j, None]) * faces[:, i] + np.abs(away[:, i, None]) * faces[:, j]
    bounds = np.concatenate([visible, visible[:, i] != visible[:, j]], axis=1)
    planes = np.where(bounds[..., None], np.concatenate([faces, ridges], axis=1), _NO_PLANE)
    first = np.argsort(~bounds, axis=1, kind="stable")[:, :_MOST]
    return np.ascontiguousarray(np.take_along_axis(planes, first[..., None], axis=1))


@inner
def most_crossings(edges):
    """Return the largest number of crossings of a circle with the edges of a view."""
    return _MOST_OF_CONE * len(edges.field) + 2 * _MOST * len(edges.shadows)


@inner
def add_crossings(edges, apex, circle, cuts, count):
    """Add to `cuts` the angles at which a circle crosses the edges of the view from `apex`.

    Returns the new count of cuts. `circle`: the points m + u cos(angle) + v sin(angle), and the
    first and the last angle."""
    centre, u, v, first, last = circle
    mx, my, mz = centre[0] - apex[0], centre[1] - apex[1], centre[2] - apex[2]
    radius = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    square = mx * mx + my * my + mz * mz + radius * radius
    e = 2.0 * (mx * u[0] + my * u[1] + mz * u[2])
    f = 2.0 * (mx * v[0] + my * v[1] + mz * v[2])
    swing = math.hypot(e, f)
    nearest = math.sqrt(max(square - swing, 0.0))
    fastest = radius if 0.5 * swing >= radius * nearest else 0.5 * swing / nearest
    for row in edges.field:
        most = count + _MOST_OF_CONE
        a, b, c = _on_circle(row, circle)
        s = row[4]
        if s == 0.0:
            count = _add_roots(a, b, c, first, last, cuts, count)
            continue
        steepest = math.hypot(b, c) + abs(s) * fastest
        if steepest <= _HAIR * radius:
            continue
        angle, before, step = first, 0.0, 0.0
        while True:
            cos, sin = math.cos(angle), math.sin(angle)
            away = math.sqrt(max(square + e * cos + f * sin, 0.0))
            value = a + b * cos + c * sin - s * away
            if before * value < 0.0 and count < most:
                cuts[count] = angle - step * value / (value - before)
                count += 1
            if angle >= last:
                break
            step = min(max(abs(value) / steepest, _STEP), last - angle)
            angle, before = angle + step, value
            if last - angle < _HAIR:
                angle = last
    for planes in edges.shadows:
        before = count
        for n in range(_MOST):
            a, b, c = _on_circle(planes[n], circle)
            if a + math.hypot(b, c) < 0.0:  # the circle passes the shadow
                count = before
                break
            count = _add_roots(a, b, c, first, last, cuts, count)
        end = before
        for k in range(before, count):
            if _inside(planes, circle, cuts[k]):
                cuts[end] = cuts[k]
                end += 1
        count = end
    return count


@inner
def _on_circle(plane, circle):
    """Return a, b, c of the plane's n p + k on a circle: a + b cos(angle) + c sin(angle)."""
    m, u, v = circle[:3]
    x, y, z = plane[0], plane[1], plane[2]
    a = x * m[0] + y * m[1] + z * m[2] + plane[3]
    return a, x * u[0] + y * u[1] + z * u[2], x * v[0] + y * v[1] + z * v[2]


@inner
def _add_roots(a, b, c, first, last, cuts, count):
    """Add the angles in (first, last) where a + b cos + c sin is 0; return the new count."""
    size = math.hypot(b, c)
    if abs(a) < size:
        azimuth, half = math.atan2(c, b), math.acos(-a / size)
        for side in range(2):
            angle = azimuth - half if side == 0 else azimuth + half
            angle = first + (angle - first) % (2.0 * math.pi)
            if angle < last:
                cuts[count] = angle
                count += 1
    return count


@inner
def _inside(planes, circle, angle):
    """Return whether a point of a circle is within a shadow or at its edge."""
    cos, sin = math.cos(angle), math.sin(angle)
    for n in range(_MOST):
        a, b, c = _on_circle(planes[n], circle)
        if a + b * cos + c * sin < -_HAIR * (abs(a) + abs(b) + abs(c)):
            return False
    return True


@inner
def sort_first(values, count):
    """Sort the first `count` values in place: few, and mostly in order."""
    for n in range(1, count):
        value, k = values[n], n
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value

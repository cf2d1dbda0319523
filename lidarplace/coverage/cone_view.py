"""The part of a cone that a sensor sees, and whether it meets a box.

The part ends at the azimuths of the field of view and at the range. From cheap to dear:

- `side_of_view`: whether all or nothing of a box is in range and field of view;
- `corners_span`: whether a cone passes between corners of a cube that are seen;
- `patch_meets`: whether the seen part of a cone meets a box, exactly."""

import math
from typing import NamedTuple

import numpy as np

from lidarplace.base.kernel_cache import inlined, inner
from lidarplace.coverage.cone_sines import HAIR, dot, segment_meets, sines_between


class View(NamedTuple):
    """Field of view and range of a sensor, in numbers alone.

    Attributes:
        n: axis of the sensor.
        first, last: normals of the planes that bound the field of view, towards the inside.
        width, reach: of the field of view, and the range."""

    n: tuple[float, float, float]
    first: tuple[float, float, float]
    last: tuple[float, float, float]
    width: float
    reach: float


@inner
def view_of(sensor):
    """Return the `View` of a `Sensor`."""
    u, v, n = sensor.frame[0], sensor.frame[1], sensor.frame[2]
    start, end = sensor.azimuth
    c, s = math.cos(start), math.sin(start)
    first = (v[0] * c - u[0] * s, v[1] * c - u[1] * s, v[2] * c - u[2] * s)
    c, s = math.cos(end), math.sin(end)
    last = (u[0] * s - v[0] * c, u[1] * s - v[1] * c, u[2] * s - v[2] * c)
    return View((n[0], n[1], n[2]), first, last, end - start, sensor.reach)


@inner
def _in_view(d, view):
    """Return whether a point is within range and field of view."""
    if dot(d, d) > view.reach * view.reach:
        return False
    if view.width >= 2 * math.pi:
        return True
    first, last = dot(view.first, d) >= 0, dot(view.last, d) >= 0
    return (first and last) if view.width <= math.pi else (first or last)


@inlined
def side_of_view(low, high, view):
    """Return 1 if all of a box is in range and field of view, -1 if nothing is; 0: undecided."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    nearest = (max(x0, -x1, 0.0), max(y0, -y1, 0.0), max(z0, -z1, 0.0))
    if dot(nearest, nearest) > view.reach * view.reach:
        return -1
    farthest = (max(-x0, x1), max(-y0, y1), max(-z0, z1))
    inside = dot(farthest, farthest) <= view.reach * view.reach
    if view.width >= 2 * math.pi:
        return 1 if inside else 0
    some_first, all_first = _side_of_plane(low, high, view.first)
    some_last, all_last = _side_of_plane(low, high, view.last)
    if view.width <= math.pi:
        if not (some_first and some_last):
            return -1
        return 1 if inside and all_first and all_last else 0
    if not (some_first or some_last):
        return -1
    return 1 if inside and (all_first or all_last) else 0


@inlined
def _side_of_plane(low, high, normal):
    """Return whether some and whether all of a box is inside of a plane through the sensor."""
    (x0, y0, z0), (x1, y1, z1), (a, b, c) = low, high, normal
    centre = (a * (x0 + x1) + b * (y0 + y1) + c * (z0 + z1)) / 2
    half = (abs(a) * (x1 - x0) + abs(b) * (y1 - y0) + abs(c) * (z1 - z0)) / 2
    return centre + half >= 0, centre - half >= 0


@inner
def _arc_meets(low, high, s, sensor):
    """Return whether the arc on which a beam ends at its range meets the box.

    A coordinate of the arc is m + r cos(a - phi). Where the arc enters or leaves the box one is on
    a face; an arc that does neither is wholly inside or outside."""
    _, frame, _, azimuth, reach = sensor
    distance, extent = -s * reach, HAIR * reach  # of the box from the plane n.d = s reach
    for axis in range(3):
        distance += 0.5 * frame[2, axis] * (low[axis] + high[axis])
        extent += 0.5 * abs(frame[2, axis]) * (high[axis] - low[axis])
    if abs(distance) > extent:
        return False
    # Angles at which the arc ends, or its circle meets a face.
    cosine = math.sqrt(1 - s * s)
    angles = np.empty(20)
    angles[0], angles[1] = azimuth
    number = 2
    for axis in range(3):
        m, a, b = frame[2, axis] * s, frame[0, axis] * cosine, frame[1, axis] * cosine
        r, phi = math.hypot(a, b), math.atan2(b, a)
        angles[number], angles[number + 1] = phi, phi + math.pi  # a face may be touched only
        number += 2
        for face in (low[axis], high[axis]):
            if r > 0 and abs(face / reach - m) <= r:
                turn = math.acos((face / reach - m) / r)
                angles[number], angles[number + 1] = phi - turn, phi + turn
                number += 2
    # Whether the arc is in the box at one of them.
    slack = 0.5 * HAIR * (high[0] - low[0])  # the point computed is on the arc up to rounding
    for angle in angles[:number]:
        past = (angle - azimuth[0]) % (2 * math.pi)
        if past > azimuth[1] - azimuth[0] and 2 * math.pi - past > 1e-12:
            continue
        within = True
        for axis in range(3):
            sideways = frame[0, axis] * math.cos(angle) + frame[1, axis] * math.sin(angle)
            point = reach * (frame[2, axis] * s + cosine * sideways)
            within &= low[axis] - slack <= point <= high[axis] + slack
        if within:
            return True
    return False


@inner
def _edge_crosses(low, high, s, view):
    """Return whether an edge of the box crosses the part of the cone that is seen."""
    n = view.n
    for axis in range(3):
        other, third = (axis + 1) % 3, (axis + 2) % 3
        for p in (low[other], high[other]):
            for q in (low[third], high[third]):
                # (A + n w)^2 = s^2 (B + w^2) for the coordinate w along the edge.
                along, square = n[other] * p + n[third] * q, p * p + q * q  # A and B
                a, b = n[axis] ** 2 - s * s, along * n[axis]
                c = along * along - s * s * square
                quarter = along * along + a * square  # b^2 - a c = s^2 times this, not cancelling
                if quarter < 0:
                    continue
                root = -(b + math.copysign(abs(s) * math.sqrt(quarter), b))
                for w in (root / a, c / root):
                    if not low[axis] <= w <= high[axis]:  # also where the root is not finite
                        continue
                    if (along + n[axis] * w) * s < 0:  # the other nappe
                        continue
                    d = (w, p, q) if axis == 0 else (q, w, p) if axis == 1 else (p, q, w)
                    if _in_view(d, view):
                        return True
    return False


@inner
def patch_meets(low, high, s, sensor, view):
    """Return whether the seen part of the cone of one beam meets a closed box.

    The part is bounded by the rays at the ends of the field of view and by the arc at the range. If
    none of these meets the box, a piece of the cone in it is seen as a whole or not at all. It
    reaches the faces along its rulings; there it ends at an edge of the box, or is a closed curve
    about the axis, which the first ray meets."""
    if _edge_crosses(low, high, s, view):
        return True
    cosine, (u, v, n) = math.sqrt(1 - s * s), sensor.frame
    for angle in sensor.azimuth:
        ca, sa = cosine * math.cos(angle), cosine * math.sin(angle)
        dx, dy = ca * u[0] + sa * v[0] + s * n[0], ca * u[1] + sa * v[1] + s * n[1]
        if segment_meets(low, high, (dx, dy, ca * u[2] + sa * v[2] + s * n[2]), view.reach):
            return True
    d = (max(-low[0], high[0]), max(-low[1], high[1]), max(-low[2], high[2]))
    if dot(d, d) <= view.reach * view.reach:  # the arc is beyond
        return False
    return _arc_meets(low, high, s, sensor)


@inner
def near_beams(centre, half, sines, n):
    """Return the first and past the last of the sines that a cube may hold."""
    away = math.sqrt(dot(centre, centre))
    if away <= 2.0 * half:
        return 0, len(sines)
    spread = 3.0 * half / away  # no sine within the cube is farther from that of its centre
    return sines_between(sines, dot(n, centre) / away - spread, dot(n, centre) / away + spread)


@inner
def corners_span(centre, half, beams, sines, view):
    """Return whether a cone of `sines[beams[0]:beams[1]]` passes between seen corners of a cube.

    What of the cube is in range and on the inner side of a plane is convex: a cone that has two
    points of it on either side meets it."""
    # The corner that is farthest inside the nearer plane comes first, then the one above or below.
    (x, y, z), whole = centre, view.width >= 2 * math.pi
    nearer = view.first if dot(view.first, centre) < dot(view.last, centre) else view.last
    dx, dy = math.copysign(half, nearer[0]), math.copysign(half, nearer[1])
    for b in range(beams[0], beams[1]):
        by_square = sines[b] * abs(sines[b])
        first_above = first_below = last_above = last_below = False
        for i in range(8):
            cx, cy = x - dx if i & 4 else x + dx, y - dy if i & 2 else y + dy
            d = (cx, cy, z + half if i & 1 else z - half)
            along, square = dot(view.n, d), dot(d, d)
            side = along * abs(along) - by_square * square  # has the sign of n.d - s |d|
            near = square <= view.reach * view.reach
            in_first = near and (whole or dot(view.first, d) >= 0)
            in_last = near and (whole or dot(view.last, d) >= 0)
            if view.width <= math.pi:
                in_first = in_last = in_first and in_last
            first_above |= in_first and side >= 0
            first_below |= in_first and side <= 0
            last_above |= in_last and side >= 0
            last_below |= in_last and side <= 0
            if (first_above and first_below) or (last_above and last_below):
                return True
    return False

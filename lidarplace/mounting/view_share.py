"""Shares of a field of view that one sensor sees, and that another one sees, too."""

import math
from collections.abc import Sequence

import numpy as np

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.mounting.field_of_view import has_direction, in_view
from lidarplace.mounting.housing import turned
from lidarplace.mounting.sight import Obstacles, stopped
from lidarplace.mounting.view_edges import add_crossings, most_crossings, sort_first

ROWS, COLUMNS = 33, 64
"""Elevations and azimuths at which a field of view is examined first; what is thin is met by some
of them. Intervals of azimuth are halved until halving changes nothing."""
STEPS = 120
"""Parts of a circle in which the edges of a mesh are searched."""
_HALVINGS = 12
_TOLERANCE = 1e-5  # of the whole, for the middle of an interval compared with its ends
_NARROWEST = 1e-4  # interval of azimuth, as a part of the whole
_NO_ANGLE, _NEAR = 1e-12, 1e-7  # radians


def steps_between_edges(obstacles: Sequence[Obstacles]) -> int:
    """Return the parts of a circle in which further edges are searched by bisection.

    `STEPS` for a mesh, 1 for round housings, 0 if all edges are planes."""
    if any(len(each.mesh.triangles) for each in obstacles):
        return STEPS
    return int(any(each.housings[:, 16].any() for each in obstacles))


@njit(cache=True, nogil=True, error_model="numpy")
def seen_parts(pair):
    """Return parts of the box of angles of a sensor: what it sees, and what both of a pair see.

    `pair`: view of the sensor and of the other one, the distance, obstacles, number and edges of
    each, and `steps_between_edges`. The integral over elevations is exact between edges, that over
    azimuths is Simpson's."""
    (lowest, highest), (start, width) = pair[0].field.sines, pair[0].field.azimuth
    cuts = np.empty(most_crossings(pair[7]) + most_crossings(pair[8]) + STEPS + 1)
    turns = np.empty(2 * len(cuts))
    if highest <= lowest:
        return _of_circle(pair, True, lowest, cuts, turns)[:2]
    nodes, count = np.empty(COLUMNS + 2 * ROWS * len(turns)), COLUMNS
    nodes[:count] = np.arange(1, count + 1) / COLUMNS
    for row in range(ROWS):
        up = lowest + row / (ROWS - 1.0) * (highest - lowest)
        number = _of_circle(pair, True, up, cuts, turns)[2]
        for n in range(1, number):
            near, far = (turns[n - 1] - start) / width, (turns[n] - start) / width
            if int(near * COLUMNS) == int(far * COLUMNS):  # columns may miss what is between
                nodes[count], nodes[count + 1] = near, far
                count += 2
    sort_first(nodes, count)
    seen, common, before = 0.0, 0.0, 0.0
    ends, columns = np.empty((_HALVINGS + 1, 2)), np.empty((_HALVINGS + 1, 4))
    s1, c1, _ = _of_circle(pair, False, start, cuts, turns)
    for node in nodes[:count]:
        if node - before < _NARROWEST:
            continue
        s0, c0 = s1, c1
        s1, c1, _ = _of_circle(pair, False, start + node * width, cuts, turns)
        ends[0], columns[0] = (before, node), (s0, c0, s1, c1)
        before, depth = node, 0
        while depth >= 0:  # a stack of intervals that are still open
            low, high = ends[depth]
            sl, cl, sh, ch = columns[depth]
            mean = 0.5 * (low + high)
            sm, cm, _ = _of_circle(pair, False, start + mean * width, cuts, turns)
            bent = max(abs(sl - 2.0 * sm + sh), abs(cl - 2.0 * cm + ch))
            if bent * (high - low) <= _TOLERANCE or depth == _HALVINGS:
                seen += (high - low) * (sl + 4.0 * sm + sh) / 6.0
                common += (high - low) * (cl + 4.0 * cm + ch) / 6.0
                depth -= 1
            else:
                ends[depth, 1], columns[depth, 2], columns[depth, 3] = mean, sm, cm
                depth += 1
                ends[depth, 0], ends[depth, 1] = mean, high
                columns[depth, 0], columns[depth, 1] = sm, cm
                columns[depth, 2], columns[depth, 3] = sh, ch
    return seen, common


@inner
def _of_circle(pair, level, at, cuts, turns):
    """Return `seen_parts` of one circle, and the number of `turns`: the angles where one changes.

    The circle has the elevation whose sine is `at` (`level`), or the azimuth `at`."""
    view, (lowest, highest), (start, width) = pair[0], pair[0].field.sines, pair[0].field.azimuth
    (ox, oy, oz), far = view.origin, pair[2]
    if level:
        up, flat = far * at, far * math.sqrt(max(1.0 - at * at, 0.0))
        x, y, z = turned(view.rotation, 0.0, 0.0, up)
        centre, first, last = (ox + x, oy + y, oz + z), start, start + width
        u, v = turned(view.rotation, flat, 0.0, 0.0), turned(view.rotation, 0.0, flat, 0.0)
    else:
        centre, first, last = (ox, oy, oz), math.asin(lowest), math.asin(highest)
        u = turned(view.rotation, far * math.cos(at), far * math.sin(at), 0.0)
        v = turned(view.rotation, 0.0, 0.0, far)
    circle = centre, u, v, first, last
    count = add_crossings(pair[7], view.origin, circle, cuts, 0)
    count = add_crossings(pair[8], pair[1].origin, circle, cuts, count)
    steps = max(pair[9], 1)
    for step in range(1, steps + 1):
        cuts[count] = first + step / steps * (last - first)
        count += 1
    sort_first(cuts, count)
    near, number, before, passed = first, 0, first, (False, False)
    seen, common = 0.0, 0.0
    for n in range(count):
        if cuts[n] - near <= _NO_ANGLE:
            continue
        angle = 0.5 * (near + cuts[n])
        status = _at_angle(pair, level, at, angle)
        for sensor in range(2):
            if status[sensor] != passed[sensor]:
                edge = near
                if pair[9] > 0 and near > first:
                    edge = _bisected(pair, level, at, sensor, before, near, angle)
                sign = -1.0 if status[sensor] else 1.0
                amount = sign * (edge if level else math.sin(edge))
                seen, common = (seen + amount, common) if sensor == 0 else (seen, common + amount)
                turns[number] = edge
                number += 1
        near, before, passed = cuts[n], angle, status
    end, whole = (last, width) if level else (highest, highest - lowest)
    seen, common = seen + passed[0] * end, common + passed[1] * end
    return seen / whole, common / whole, number


@inner
def _bisected(pair, level, at, sensor, low, cut, high):
    """Return the angle between two of a circle at which a status changes, probably `cut`."""
    before = _at_angle(pair, level, at, low)[sensor]
    if _at_angle(pair, level, at, cut - _NEAR)[sensor] == before:
        low = cut - _NEAR
    if _at_angle(pair, level, at, cut + _NEAR)[sensor] != before:
        high = cut + _NEAR
    while high - low > 2.5 * _NEAR:
        mean = 0.5 * (low + high)
        if _at_angle(pair, level, at, mean)[sensor] == before:
            low = mean
        else:
            high = mean
    return 0.5 * (low + high)


@inner
def _at_angle(pair, level, at, angle):
    return _status(pair, at, angle) if level else _status(pair, math.sin(angle), at)


@inner
def _status(pair, up, azimuth):
    """Return whether a sensor sees in a direction of its frame, and the other one that point."""
    view, other, at, hides, hides_other, number, another = pair[:7]
    level = math.sqrt(max(1.0 - up * up, 0.0))
    ahead, left = level * math.cos(azimuth), level * math.sin(azimuth)
    if not has_direction(view.field, ahead, left, up):
        return False, False
    o, (dx, dy, dz) = view.origin, turned(view.rotation, ahead, left, up)
    if stopped(o, dx, dy, dz, at, hides, number):
        return False, False
    x, y, z = o[0] + at * dx, o[1] + at * dy, o[2] + at * dz
    if not in_view(other, x, y, z):
        return True, False
    p = other.origin
    return True, not stopped(p, x - p[0], y - p[1], z - p[2], 1.0, hides_other, another)

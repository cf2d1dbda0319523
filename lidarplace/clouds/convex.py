"""A convex part as a sensor sees it: the window of angles that it fills, and its planes.

`lidarplace.clouds.raycast` explains how a ray meets them."""

import math
from typing import NamedTuple

import numpy as np

from lidarplace.base.kernel_cache import inlined, inner


@inner
def fill_corners(part, corners):
    """Fill `corners`, shape (8, 3): bit 0 of the row is front, bit 1 left, bit 2 top."""
    c, s = math.cos(part[6]), math.sin(part[6])
    for n in range(8):
        top = 1.0 if n & 4 else 0.0
        lx = 0.5 * part[3] - top * part[7] if n & 1 else top * part[8] - 0.5 * part[3]
        ly = (0.5 * part[4] - top * part[9]) * (1.0 if n & 2 else -1.0)
        corners[n, 0] = part[0] + c * lx - s * ly
        corners[n, 1] = part[1] + s * lx + c * ly
        corners[n, 2] = part[2] + (top - 0.5) * part[5]


@inlined
def plane_of(part, face, place):
    """Return the outward normal of a plane of a part, and how far a place is outside of it.

    In the frame of the part, whose origin is in its middle."""
    hx, hy, hz = 0.5 * part[3], 0.5 * part[4], 0.5 * part[5]
    ox, oy, oz = place
    sign = 1.0 if face & 1 else -1.0
    out, up = 1.0, 0.0
    if face < 4:
        inset = part[9] if face >= 2 else part[7] if face == 1 else part[8]
        if part[5] > 0.0 and inset != 0.0:
            slant = math.hypot(part[5], inset)
            out, up = part[5] / slant, inset / slant
    if face < 2:
        return sign * out, 0.0, up, out * (sign * ox - hx) + up * (oz + hz)
    if face < 4:
        return 0.0, sign * out, up, out * (sign * oy - hy) + up * (oz + hz)
    return 0.0, 0.0, sign, sign * oz - hz


@inner
def fill_planes(part, origin, rotation, planes):
    """Fill the planes of a part, those that face the sensor first; return how many do.

    Row k of `planes`, shape (6, 5): a ray along the unit vector d, sensor's frame, meets the plane
    at the inverse distance `planes[k, :3] . d + planes[k, 3]`; times `planes[k, 4]` it is the
    cosine of incidence. A sensor in a plane itself, so near that the inverse would overflow, meets
    it at once, if it dives, or never; then a ray along it stays open to the other planes, and
    misses if there are none."""
    c, s = math.cos(part[6]), math.sin(part[6])
    ex, ey, oz = origin[0] - part[0], origin[1] - part[1], origin[2] - part[2]
    ox, oy = c * ex + s * ey, c * ey - s * ex
    facing, others, along = 0, 6, 0
    for face in range(6):
        nx, ny, nz, distance = plane_of(part, face, (ox, oy, oz))
        bias = 0.0
        if abs(distance) < 1e-290:
            distance, bias = 1e-300, 1e10
            along += 1
        if distance > 0.0:
            row = facing
            facing += 1
        else:
            others -= 1
            row = others
        ax, ay = c * nx - s * ny, s * nx + c * ny
        for k in range(3):
            toward = ax * rotation[0, k] + ay * rotation[1, k] + nz * rotation[2, k]
            planes[row, k] = -toward / distance
        planes[row, 3] = bias
        planes[row, 4] = distance
    if facing == along:
        for row in range(facing):
            planes[row, 3] = -planes[row, 3]
    return facing


@inner
def span(origin, way, low, high):
    """Return from where to where a ray is between two planes across an axis."""
    if way == 0.0:
        return (-np.inf, np.inf) if low <= origin <= high else (np.inf, -np.inf)
    a, b = (low - origin) / way, (high - origin) / way
    return min(a, b), max(a, b)


@inner
def shorter_turn(start, end):
    """Return the shorter way from one azimuth in [-pi, pi] to another."""
    turn = end - start
    if turn > math.pi:
        return turn - 2 * math.pi
    return turn + 2 * math.pi if turn < -math.pi else turn


class Window(NamedTuple):
    """Azimuths, elevations and distances at which a part can appear in the sensor's frame.

    Attributes:
        azimuth, right, left: a direction to the part, and how far the part reaches to either side
            of it, radians; pi if the sensor's axis meets the part or passes close by.
        lowest, highest: bounds of the elevation, radians.
        nearest, farthest: bounds of the distance, metres.
        axis_distance: least distance from the sensor's axis, metres."""

    azimuth: float
    right: float
    left: float
    lowest: float
    highest: float
    nearest: float
    farthest: float
    axis_distance: float


@inner
def window_of(corners, origin, rotation):
    """Return the `Window` of a part.

    The azimuths are those of the corners, exact; elevations and distances are bounds, from the
    corners' heights and the ring around the axis that holds the part."""
    seen = np.empty((8, 3))
    mx = my = 0.0
    for n in range(8):
        ex, ey = corners[n, 0] - origin[0], corners[n, 1] - origin[1]
        ez = corners[n, 2] - origin[2]
        for k in range(3):
            seen[n, k] = rotation[0, k] * ex + rotation[1, k] * ey + rotation[2, k] * ez
        mx += seen[n, 0]
        my += seen[n, 1]
    azimuth = math.atan2(my, mx)
    right = left = far = 0.0
    near = np.inf
    lowest, highest = np.inf, -np.inf
    for n in range(8):
        x, y = seen[n, 0], seen[n, 1]
        turn = shorter_turn(azimuth, math.atan2(y, x))
        right, left = max(right, -turn), max(left, turn)
        far = max(far, x * x + y * y)
        lowest, highest = min(lowest, seen[n, 2]), max(highest, seen[n, 2])
        for bit in (1, 2, 4):  # the edges from here; seen along the axis they bound the part
            if not n & bit:
                ex, ey = seen[n | bit, 0] - x, seen[n | bit, 1] - y
                square = ex * ex + ey * ey
                t = -(x * ex + y * ey) / square if square > 0.0 else 0.0
                t = min(max(t, 0.0), 1.0)
                near = min(near, (x + t * ex) ** 2 + (y + t * ey) ** 2)
    near, far = math.sqrt(near), math.sqrt(far)
    # Seen from outside, a convex shape spans less than half a turn.
    if right + left > math.pi - 1e-6 or near < 1e-6:
        right = left = math.pi
        near = 0.0
    height = max(max(lowest, -highest), 0.0)
    reach = max(abs(lowest), abs(highest))
    down = math.atan2(lowest, near if lowest < 0 else far)
    up = math.atan2(highest, near if highest > 0 else far)
    distances = math.hypot(near, height), math.hypot(far, reach)
    return Window(azimuth, right, left, down - 1e-9, up + 1e-9, *distances, near)


@inner
def enter_along(cosines, sines, planes, facing, ce, se, enter):
    """Write the inverse distances at which rays of a beam enter a part to the start of `enter`.

    They are negative for rays that miss it. Cosines and sines are of the azimuths, `ce` and `se` of
    the elevation."""
    number = len(cosines)
    for k in range(6):
        a, b, c = ce * planes[k, 0], ce * planes[k, 1], se * planes[k, 2] + planes[k, 3]
        if k == 0:
            for n in range(number):
                enter[n] = a * cosines[n] + b * sines[n] + c
        elif k < facing:
            for n in range(number):
                enter[n] = min(enter[n], a * cosines[n] + b * sines[n] + c)
        else:
            for n in range(number):
                leave = a * cosines[n] + b * sines[n] + c
                enter[n] = enter[n] if enter[n] >= leave else -1.0

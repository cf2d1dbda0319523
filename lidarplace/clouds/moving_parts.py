"""A convex part that moves, as a sensor of a moving vehicle sees it: place, windows and planes.

`lidarplace.clouds.moving` explains how rays meet it."""

import math

import numpy as np

from lidarplace.base.kernel_cache import inlined
from lidarplace.clouds.convex import Window, plane_of


@inlined
def place_at(box, motion, part, rides, t, moved, rate):
    """Fill where a part is in the frame of the vehicle at a moment, and its velocity and yaw rate.

    Returns the bound of the speed of its points from then to the end of the scan, nearly. `rides`:
    whether it is of the vehicle."""
    ego, parts, moves = motion.ego, motion.parts, 0.0 if rides else 1.0
    ux, uy, turn = moves * ego[0], moves * ego[1], moves * ego[2]
    cx, cy, spin = parts[part, 0], parts[part, 1], moves * parts[part, 4]
    vx, vy = moves * parts[part, 2] - ux, moves * parts[part, 3] - uy
    c, s, rx, ry = math.cos(spin * t), math.sin(spin * t), box[0] - cx, box[1] - cy
    rx, ry = c * rx - s * ry, s * rx + c * ry
    x, y, wx, wy = cx + vx * t + rx, cy + vy * t + ry, vx - spin * ry, vy + spin * rx
    c, s = math.cos(turn * t), math.sin(turn * t)
    for n in range(len(moved)):
        moved[n] = box[n]
    moved[0], moved[1], moved[6] = c * x + s * y, c * y - s * x, box[6] + (spin - turn) * t
    rate[0] = c * wx + s * wy + turn * moved[1]
    rate[1] = c * wy - s * wx - turn * moved[0]
    rate[2] = spin - turn
    speed = math.sqrt(rate[0] ** 2 + rate[1] ** 2)
    return 1.1 * (speed + abs(rate[2]) * math.sqrt(box[3] ** 2 + box[4] ** 2))


@inlined
def is_beyond(box, metres, origin, crop):
    """Return whether a part whose points may be so many metres away is apart as in `is_apart`."""
    radius = metres + 0.5 * math.sqrt(box[3] ** 2 + box[4] ** 2 + box[5] ** 2)
    beyond = False
    for axis in range(3):
        low, top = min(crop[axis], origin[axis]), max(crop[axis + 3], origin[axis])
        beyond |= box[axis] + radius < low or box[axis] - radius > top
    return beyond


@inlined
def window_around(box, metres, origin, rotation):
    """Return a window around the sphere that holds a part whose points may be so many metres away.

    Its elevations are not bounded."""
    ex, ey, ez = box[0] - origin[0], box[1] - origin[1], box[2] - origin[2]
    x = rotation[0, 0] * ex + rotation[1, 0] * ey + rotation[2, 0] * ez
    y = rotation[0, 1] * ex + rotation[1, 1] * ey + rotation[2, 1] * ez
    radius = metres + 0.5 * math.sqrt(box[3] ** 2 + box[4] ** 2 + box[5] ** 2)
    axis_distance = math.sqrt(x**2 + y**2)
    turn = math.asin(radius / axis_distance) if radius < axis_distance else math.pi
    nearest = math.sqrt(ex**2 + ey**2 + ez**2) - radius
    return Window(math.atan2(y, x), turn, turn, -math.pi, math.pi, nearest, np.inf, axis_distance)


@inlined
def grown_window(window, metres):
    """Return the window of a part whose points may be so many metres away."""
    azimuth, right, left, lowest, highest, nearest, farthest, axis_distance = window
    aside = math.asin(metres / axis_distance) if metres < axis_distance else math.pi
    up = math.asin(metres / nearest) if metres < nearest else math.pi
    if metres > 0.0:
        right, left = min(right + aside, math.pi), min(left + aside, math.pi)
        lowest, highest, nearest = lowest - up, highest + up, nearest - metres
    return Window(azimuth, right, left, lowest, highest, nearest, farthest, axis_distance)


@inlined
def fill_moving_planes(part, rate, pose, reach, planes):
    """Fill the planes of a part that moves, shape (6, 8); return how many may face the sensor.

    These are first: they face it within a time of `reach`. Of each its inward normal in the
    sensor's frame and the rate at which that turns, and the signed distance of the sensor outside
    of it and its rate. `pose` are origin and rotation of the sensor."""
    origin, rotation = pose
    c, s = math.cos(part[6]), math.sin(part[6])
    ex, ey, oz = origin[0] - part[0], origin[1] - part[1], origin[2] - part[2]
    place, facing, others = (c * ex + s * ey, c * ey - s * ex, oz), 0, 6
    for face in range(6):
        nx, ny, nz, distance = plane_of(part, face, place)
        ax, ay = c * nx - s * ny, s * nx + c * ny
        change = rate[2] * (ax * ey - ay * ex) - ax * rate[0] - ay * rate[1]
        if distance + reach * abs(change) > 0.0:
            row = facing
            facing += 1
        else:
            others -= 1
            row = others
        for k in range(3):
            planes[row, k] = -(ax * rotation[0, k] + ay * rotation[1, k] + nz * rotation[2, k])
            planes[row, 3 + k] = -rate[2] * (ax * rotation[1, k] - ay * rotation[0, k])
        planes[row, 6], planes[row, 7] = distance, change
    return facing

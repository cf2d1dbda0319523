"""Cast the rays of a LiDAR that takes time for a frame, while parts and vehicle move.

Each ray meets every part where that is at the moment of the ray, in the frame of the vehicle at
that moment. The scan is cut into short spans of time. In each, parts are placed at its middle, and
move from there to first order: exactly along a line, and with an error of the square of the angle
by which they turn within half a span. `lidarplace.clouds.raycast` explains how rays meet parts.

The distance of the sensor to a plane changes with the moment, not with the beam. So the inverse
distances at which rays of a span meet a plane are `ce a + se b`, with a and b of each azimuth."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inlined, inner, njit
from lidarplace.clouds.convex import Window, fill_corners, plane_of, window_of
from lidarplace.clouds.raycast import (
    EVERYWHERE,
    GROUND,
    NO_ENDS,
    NOTHING,
    Hits,
    Nearest,
    Surfaces,
    along,
    beams_in,
    height_over_ground,
    is_apart,
    is_between,
    rays_of,
    runs,
    start_nearest,
)
from lidarplace.clouds.shapes import BODY, PANE, Parts
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount

SPANS = 8
"""Spans of time of a scan; one more where it begins between two azimuth steps."""


class Motion(NamedTuple):
    """Motion in a frame, in the axes of the vehicle at the frame's moment.

    Attributes:
        ego: velocity of the vehicle over ground, m/s, and its yaw rate, rad/s, shape (3,).
        parts: x and y of the point about which each part turns, its velocity over ground and its
            yaw rate, shape (P, 5)."""

    ego: NDArray[np.float64]
    parts: NDArray[np.float64]


class Scan(NamedTuple):
    """Moments of rays, as compiled code takes them.

    Attributes:
        moments: seconds, shape (1, fired_steps), of a pattern (beams, 1).
        spans: earliest and latest moment of each span of time, seconds, and its first and past the
            last step, shape (S, 4)."""

    moments: NDArray[np.float64]
    spans: NDArray[np.float64]


def scan_of(moments: NDArray[np.float64]) -> Scan:
    """Cut moments, of `ScanTiming`, into spans of time."""
    if moments.shape[1] == 1:  # a pattern: all its rays are in each span, and those of others pass
        edges = np.linspace(moments.min(), moments.max(), SPANS + 1)
        edges[-1] = np.inf
        ends = np.tile([0.0, 1.0], (SPANS, 1))
        return Scan(moments, np.column_stack([edges[:-1], edges[1:], ends]))
    steps = moments.shape[1]
    seam = np.flatnonzero(np.abs(np.diff(moments[0])) > 0.5 * np.ptp(moments)) + 1
    edges = np.unique(np.concatenate([np.linspace(0, steps, SPANS + 1).round(), seam]))
    ends = np.stack([edges[:-1], edges[1:]], axis=1)
    times = np.sort(moments[0][ends.astype(np.int64) - [0, 1]], axis=1)
    return Scan(moments, np.column_stack([times, ends]))


def part_motion(
    parts: Parts, centres: NDArray[np.float64], rates: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return `Motion.parts`; of the objects `centres` are x, y, and `rates` of `LogMotion`."""
    owner = np.where(parts.owner <= PANE, PANE - parts.owner, parts.owner)
    motion = np.zeros((len(parts), 5))
    motion[owner >= 0] = np.column_stack([centres, rates])[owner[owner >= 0]]
    return motion


def cast_moving(
    mount: Mount,
    lidar: Lidar,
    parts: Parts,
    motion: Motion,
    moments: NDArray[np.float64],
    crop: Sequence[float] = EVERYWHERE,
    into: Hits | None = None,
    ends: NDArray[np.float64] = NO_ENDS,
) -> Hits:
    """Cast all rays of one LiDAR at moving parts and flat ground, which `parts` are at moment 0.

    Ranges are in the frame of the vehicle at the `moments` of the rays, of `ScanTiming`, which the
    body of the vehicle does not leave. Other arguments as of `lidarplace.clouds.raycast.cast`; the
    crop holds at each moment."""
    number = lidar.rays
    hits = into or Hits(np.empty(number), np.empty(number, np.int32), np.empty(number))
    surfaces = Surfaces(parts.geometry, parts.owner, parts.reflectivity)
    region, scan = np.array(crop, np.float64), scan_of(moments)
    for rays, numbers in rays_of(mount, lidar):
        _cast(rays, surfaces, (motion, scan), region, ends[numbers], hits.of(numbers))
    return hits


@njit(cache=True, nogil=True, error_model="numpy")
def poses_at(moments, ego):
    """Return cosine and sine of the yaw of the vehicle at moments, and its x and y; (n, m, 4)."""
    poses = np.empty((*moments.shape, 4))
    for n in range(moments.shape[0]):
        for m in range(moments.shape[1]):
            t = moments[n, m]
            poses[n, m, 0], poses[n, m, 1] = math.cos(ego[2] * t), math.sin(ego[2] * t)
            poses[n, m, 2], poses[n, m, 3] = ego[0] * t, ego[1] * t
    return poses


class _Faces(NamedTuple):
    """Parts in spans of time.

    Attributes:
        planes: of each, see `_fill_planes`, shape (n, 6, 8).
        part, centre: number of each, and the centre of its span, shape (n,)."""

    planes: NDArray[np.float64]
    part: NDArray[np.int32]
    centre: NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def _cast(rays, surfaces, moving, crop, ends, hits):
    """Fill the `hits` of `Rays` on `Surfaces`; further arguments as of `cast_moving`."""
    (origin, rotation, beams), (motion, scan) = rays, moving
    number, steps, spans = len(surfaces.owner), beams.azimuths.shape[2], len(scan.spans)
    nearest = Nearest(np.empty(len(hits.range)), np.empty(len(hits.range), np.int32))
    start_nearest(rays, ends, True, nearest)
    most = number * spans
    faces = _Faces(np.empty((most, 6, 8)), np.empty(most, np.int32), np.empty(most))
    corners, count, moved, rate = np.empty((8, 3)), 0, np.empty(10), np.empty(3)
    memory, region = (np.empty((6, 2, steps)), np.empty(steps)), np.empty(6)
    half = np.abs(scan.moments).max()
    for part in range(number):
        box, rides = surfaces.geometry[part], surfaces.owner[part] == BODY
        speed = _place(box, motion, part, rides, 0.0, moved, rate)
        around = _around(box, speed * half, origin, rotation)
        if around.nearest > beams.reach:
            continue
        steps_around = runs(beams, 0, around)
        for span in range(spans):
            early, late = scan.spans[span, 0], min(scan.spans[span, 1], half)
            within = int(scan.spans[span, 2]), int(scan.spans[span, 3])
            if len(beams.aimed) == 0 and not _overlap(steps_around, within):
                continue
            centre, reach = 0.5 * (early + late), 0.5 * (late - early)
            speed = _place(box, motion, part, rides, centre, moved, rate)
            fill_corners(moved, corners)
            for axis in range(3):
                region[axis] = crop[axis] - speed * reach
                region[3 + axis] = crop[3 + axis] + speed * reach
            if is_apart(corners, origin, region):
                continue
            window = _grown(window_of(corners, origin, rotation), speed * reach)
            if window.nearest > beams.reach or not is_between(beams, window):
                continue
            _fill_planes(moved, rate, origin, rotation, faces.planes[count])
            faces.part[count], faces.centre[count] = part, centre
            _meet(beams, window, (faces, count), (scan, span), memory, nearest)
            count += 1
    _fill_hits(rays, surfaces, faces, scan, nearest, hits)


@inner
def _place(box, motion, part, rides, t, moved, rate):
    """Fill where a part is in the frame of the vehicle at a moment, and its velocity and yaw rate.

    Returns the bound of the speed of its points from then to the end of the scan, nearly. `rides`:
    whether it is of the vehicle."""
    moved[:] = box
    rate[:] = 0.0
    if rides:
        return 0.0
    (ux, uy, turn), (cx, cy, vx, vy, spin) = motion.ego, motion.parts[part]
    c, s, rx, ry = math.cos(spin * t), math.sin(spin * t), box[0] - cx, box[1] - cy
    rx, ry = c * rx - s * ry, s * rx + c * ry
    x, y = cx + (vx - ux) * t + rx, cy + (vy - uy) * t + ry
    wx, wy = vx - ux - spin * ry, vy - uy + spin * rx
    c, s = math.cos(turn * t), math.sin(turn * t)
    moved[0], moved[1], moved[6] = c * x + s * y, c * y - s * x, box[6] + (spin - turn) * t
    rate[0] = c * wx + s * wy + turn * moved[1]
    rate[1] = c * wy - s * wx - turn * moved[0]
    rate[2] = spin - turn
    return 1.1 * (math.hypot(rate[0], rate[1]) + abs(rate[2]) * math.hypot(box[3], box[4]))


@inner
def _around(box, metres, origin, rotation):
    """Return a window around the sphere that holds a part whose points may be so many metres away.

    Its elevations are not bounded."""
    ex, ey, ez = box[0] - origin[0], box[1] - origin[1], box[2] - origin[2]
    x = rotation[0, 0] * ex + rotation[1, 0] * ey + rotation[2, 0] * ez
    y = rotation[0, 1] * ex + rotation[1, 1] * ey + rotation[2, 1] * ez
    radius = metres + 0.5 * math.sqrt(box[3] ** 2 + box[4] ** 2 + box[5] ** 2)
    axis_distance = math.hypot(x, y)
    turn = math.asin(radius / axis_distance) if radius < axis_distance else math.pi
    nearest = math.sqrt(ex**2 + ey**2 + ez**2) - radius
    return Window(math.atan2(y, x), turn, turn, -math.pi, math.pi, nearest, np.inf, axis_distance)


@inner
def _grown(window, metres):
    """Return the window of a part whose points may be so many metres away."""
    azimuth, right, left, lowest, highest, nearest, farthest, axis_distance = window
    if metres >= axis_distance:
        return Window(azimuth, math.pi, math.pi, -math.pi, math.pi, 0.0, farthest, 0.0)
    angle = math.asin(metres / axis_distance)
    right, left = min(right + angle, math.pi), min(left + angle, math.pi)
    lowest, highest, nearest = lowest - angle, highest + angle, nearest - metres
    return Window(azimuth, right, left, lowest, highest, nearest, farthest, axis_distance)


@inlined
def _overlap(ends, within):
    """Return whether one of two runs of steps has a step within others."""
    (a, b), (c, d) = ends
    return max(a, within[0]) < min(b, within[1]) or max(c, within[0]) < min(d, within[1])


@inner
def _fill_planes(part, rate, origin, rotation, planes):
    """Fill the planes of a part that moves, shape (6, 8).

    Of each its inward normal in the sensor's frame and the rate at which that turns, and the
    signed distance of the sensor outside of it and its rate."""
    c, s = math.cos(part[6]), math.sin(part[6])
    ex, ey, oz = origin[0] - part[0], origin[1] - part[1], origin[2] - part[2]
    place = c * ex + s * ey, c * ey - s * ex, oz
    for face in range(6):
        nx, ny, nz, distance = plane_of(part, face, place)
        ax, ay = c * nx - s * ny, s * nx + c * ny
        for k in range(3):
            planes[face, k] = -(ax * rotation[0, k] + ay * rotation[1, k] + nz * rotation[2, k])
            planes[face, 3 + k] = -rate[2] * (ax * rotation[1, k] - ay * rotation[0, k])
        planes[face, 6] = distance
        planes[face, 7] = rate[2] * (ax * ey - ay * ex) - ax * rate[0] - ay * rate[1]


@inlined
def _distance(plane, t):
    """Return the distance of the sensor outside of a plane, never 0."""
    distance = plane[6] + t * plane[7]
    return distance if abs(distance) > 1e-290 else 1e-290


@inner
def _meet(beams, window, face, when, memory, nearest):
    """Let the rays of a span of time that enter a part meet it where nothing nearer is met."""
    scan, span = when
    early, late = scan.spans[span, 0], scan.spans[span, 1]
    low, top = int(scan.spans[span, 2]), int(scan.spans[span, 3])
    start, end = beams_in(beams, window)
    if len(beams.aimed) == 0:
        for first, last in runs(beams, 0, window):
            steps = max(first & ~7, low), min((last + 7) & ~7, top)
            _meet_beams(beams, window, (start, end), steps, face, scan.moments[0], memory, nearest)
        return
    for beam in range(start, end):
        if early <= scan.moments[beam, 0] < late:
            times = scan.moments[beam]
            _meet_beams(beams, window, (beam, beam + 1), (0, 1), face, times, memory, nearest)


@inner
def _meet_beams(beams, window, some, ends, face, times, memory, nearest):
    """Let the steps of some beams, from first to past the last, meet a part.

    Runs of steps in which the sensor stays on the same side of each plane are met at once."""
    (faces, number), (lines, enter), (inverses, numbers) = face, memory, nearest
    cosines, sines = along(beams, some[0])
    planes, centre, steps = faces.planes[number], faces.centre[number], beams.azimuths.shape[2]
    first, end = ends
    while first < end:
        last = _same_sides(planes, times, centre, first, end)
        facing = _fill_lines(planes, cosines, sines, times, centre, (first, last), lines)
        size = last - first
        for beam in range(some[0], some[1] if facing > 0 else some[0]):
            elevation, ce, se = beams.elevations[beam]
            if not window.lowest <= elevation <= window.highest:
                continue
            _enter(lines, facing, ce, se, enter[:size])
            inverse = inverses[beam * steps + first : beam * steps + last]
            of_ray = numbers[beam * steps + first : beam * steps + last]
            for n in range(size):
                nearer = enter[n] > inverse[n]
                inverse[n] = enter[n] if nearer else inverse[n]
                of_ray[n] = number if nearer else of_ray[n]
        first = last


@inner
def _same_sides(planes, times, centre, first, end):
    """Return the end of the steps from `first` on at which the same planes face the sensor."""
    last = end
    for k in range(6):
        side = _distance(planes[k], times[first] - centre) > 0.0
        if (_distance(planes[k], times[last - 1] - centre) > 0.0) != side:
            n = first + 1
            while (_distance(planes[k], times[n] - centre) > 0.0) == side:
                n += 1
            last = n
    return last


@inner
def _fill_lines(planes, cosines, sines, times, centre, ends, lines):
    """Fill a and b of each plane, those that face the sensor first; return how many do."""
    first, last = ends
    cosines, sines, times = cosines[first:last], sines[first:last], times[first:last]
    facing, others = 0, 6
    for k in range(6):
        plane = planes[k]
        if _distance(plane, times[0] - centre) > 0.0:
            row = facing
            facing += 1
        else:
            others -= 1
            row = others
        a, b = lines[row, 0, : len(times)], lines[row, 1, : len(times)]
        for n in range(len(times)):
            t = times[n] - centre
            inverse = 1.0 / _distance(plane, t)
            x, y, z = plane[0] + t * plane[3], plane[1] + t * plane[4], plane[2] + t * plane[5]
            a[n], b[n] = (x * cosines[n] + y * sines[n]) * inverse, z * inverse
    return facing


@inner
def _enter(lines, facing, ce, se, enter):
    """Write the inverse distances at which rays of a beam enter a part; negative: they miss it."""
    number = len(enter)
    for k in range(6):
        a, b = lines[k, 0], lines[k, 1]
        if k == 0:
            for n in range(number):
                enter[n] = ce * a[n] + se * b[n]
        elif k < facing:
            for n in range(number):
                enter[n] = min(enter[n], ce * a[n] + se * b[n])
        else:
            for n in range(number):
                leave = ce * a[n] + se * b[n]
                enter[n] = enter[n] if enter[n] >= leave else -1.0


@inner
def _fill_hits(rays, surfaces, faces, scan, nearest, hits):
    """Turn what every ray meets into hits: range, owner and reflected light."""
    beams, (ranges, targets, reflected), (inverses, numbers) = rays.beams, hits, nearest
    steps, high = beams.azimuths.shape[2], height_over_ground(rays, True)
    for beam in range(len(beams.elevations)):
        _, ce, se = beams.elevations[beam]
        cosines, sines = along(beams, beam)
        times = scan.moments[beam if len(beams.aimed) else 0]
        for n in range(steps):
            ray = beam * steps + n
            face, inverse = numbers[ray], inverses[ray]
            if face < 0:
                ranges[ray] = np.inf if face == NOTHING else 1.0 / inverse
                reflected[ray] = min(inverse * high, 1.0) if face == GROUND else 0.0
                targets[ray] = face
                continue
            # The plane of the least inverse distance, toward / distance, of those that face.
            cosine, away, t = np.inf, 1.0, times[n] - faces.centre[face]
            for k in range(6):
                plane = faces.planes[face, k]
                x, y, z = plane[0] + t * plane[3], plane[1] + t * plane[4], plane[2] + t * plane[5]
                toward = ce * (x * cosines[n] + y * sines[n]) + se * z
                distance = plane[6] + t * plane[7]
                if distance > 0.0 and toward * away < cosine * distance:
                    cosine, away = toward, distance
            part = faces.part[face]
            ranges[ray], targets[ray] = 1.0 / inverse, surfaces.owner[part]
            reflected[ray] = min(cosine, 1.0) * surfaces.reflectivity[part]

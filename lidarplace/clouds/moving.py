"""Cast the rays of a LiDAR that takes time for a frame, while parts and vehicle move.

Each ray meets every part where that is at the moment of the ray, in the frame of the vehicle at
that moment. A part is placed once: in the middle of the time in which the scan passes the azimuths
at which it may be. From there it moves to first order: exactly along a line, and with an error of
the square of the angle by which it turns. So a part is placed once more for the other side of the
seam, where the scan begins and ends, and for every `MOST_TURN` by which it turns. Rays of a pattern
are spread over the whole time, so that all of it counts. `lidarplace.clouds.raycast` explains how
rays meet parts.

The distance of the sensor to a plane changes with the moment, not with the beam. So the inverse
distances at which rays meet a plane are `ce a + se b`, with a and b of each azimuth.

Loops run over whole arrays by unsigned steps: a slice for each part and beam would count its
references, and steps with a sign would be tested for it, which is no vector code."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inlined, njit
from lidarplace.clouds.convex import fill_corners, fill_planes, window_of
from lidarplace.clouds.moving_parts import (
    fill_moving_planes,
    grown_window,
    is_beyond,
    place_at,
    window_around,
)
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
    meet_part,
    rays_of,
    runs,
    start_nearest,
)
from lidarplace.clouds.shapes import BODY, PANE, Parts
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount

MOST_TURN = 0.01
"""Angle by which a part turns while it is placed once, radians."""
_MOST_PIECES = 8  # into which a run of steps is cut
_BLOCK = 16  # of numbers that are compared at once
_MOST_RUNS = 4  # of steps at which a part may be: two, and each may be cut by the seam


class Motion(NamedTuple):
    """Motion in a frame, in the axes of the vehicle at the frame's moment.

    Attributes:
        ego: velocity of the vehicle over ground, m/s, and its yaw rate, rad/s, shape (3,).
        parts: x and y of the point about which each part turns, its velocity over ground and its
            yaw rate, shape (P, 5)."""

    ego: NDArray[np.float64]
    parts: NDArray[np.float64]


class Scan(NamedTuple):
    """Moments of the rays of a LiDAR in a frame.

    Attributes:
        moments: seconds after the frame's, of every step, shape (1, fired_steps); of a pattern of
            every ray, shape (rays, 1).
        half: the largest of their sizes.
        seam: step before which the scan of a LiDAR that turns ends; 0: it ends at the last."""

    moments: NDArray[np.float64]
    half: float
    seam: int

    @classmethod
    def at(cls, moments: NDArray[np.float64]) -> "Scan":
        """Return the scan with these `moments`, of `ScanTiming.moments`."""
        half = float(np.abs(moments).max())
        leaps = np.abs(np.diff(moments[0], prepend=moments[0, 0])) > half
        return cls(moments, half, int(leaps.argmax()))


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
    scan: Scan,
    crop: Sequence[float] = EVERYWHERE,
    into: Hits | None = None,
    ends: NDArray[np.float64] = NO_ENDS,
) -> Hits:
    """Cast all rays of one LiDAR at moving parts and flat ground, which `parts` are at moment 0.

    Ranges are in the frame of the vehicle at the moments of the rays, which the body of the vehicle
    does not leave. Other arguments as of `lidarplace.clouds.raycast.cast`; the crop holds at each
    moment."""
    number = lidar.rays
    hits = into or Hits(np.empty(number), np.empty(number, np.int32), np.empty(number))
    surfaces = Surfaces(parts.geometry, parts.owner, parts.reflectivity)
    region = np.array(crop, np.float64)
    for rays, numbers in rays_of(mount, lidar):
        _cast(rays, surfaces, (motion, scan), region, ends[numbers], hits.of(numbers))
    return hits


def poses_at(moments: NDArray[np.float64], ego: Sequence[float]) -> NDArray[np.float64]:
    """Return cosine and sine of the yaw of the vehicle at moments, and its x and y.

    Of moments of the shape (n, m) they have the shape (n, 4, m)."""
    turn = ego[2] * moments
    return np.stack([np.cos(turn), np.sin(turn), ego[0] * moments, ego[1] * moments], axis=1)


class _Faces(NamedTuple):
    """Placed parts.

    Attributes:
        planes: of each, see `fill_moving_planes`, shape (n, 6, 8).
        facing: how many of its planes, the first ones, may face the sensor, shape (n,).
        part, centre: number of each, and the moment at which it is placed, shape (n,)."""

    planes: NDArray[np.float64]
    facing: NDArray[np.int32]
    part: NDArray[np.int32]
    centre: NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def _cast(rays, surfaces, moving, crop, ends, hits):
    """Fill the `hits` of `Rays` on `Surfaces`; further arguments as of `cast_moving`."""
    (origin, rotation, beams), (motion, (moments, half, seam)) = rays, moving
    number, steps = len(surfaces.owner), beams.azimuths.shape[2]
    nearest = Nearest(hits.range, hits.target)
    start_nearest(rays, ends, True, nearest)
    most = number * _MOST_RUNS * _MOST_PIECES
    numbers = np.empty(most, np.int32), np.empty(most, np.int32)
    faces, count = _Faces(np.empty((most, 6, 8)), *numbers, np.empty(most)), 0
    corners, moved, rate, region = np.empty((8, 3)), np.empty(10), np.empty(3), np.empty(6)
    fixed = np.empty((6, 5))  # planes of what does not move
    memory, pieces = np.empty((13, steps)), np.empty((_MOST_RUNS * _MOST_PIECES, 4))
    for part in range(number):
        box, rides = surfaces.geometry[part], surfaces.owner[part] == BODY
        speed = place_at(box, motion, part, rides, 0.0, moved, rate)
        turn = 0.0 if rides else abs(motion.ego[2]) + abs(motion.parts[part, 4])
        if is_beyond(box, speed * half, origin, crop):
            continue
        around = window_around(box, speed * half, origin, rotation)
        if around.nearest > beams.reach:
            continue
        for n in range(_cut(beams, moments, (half, speed, turn, seam), around, pieces)):
            early, late = pieces[n, 2], pieces[n, 3]
            centre, reach = 0.5 * (early + late), 0.5 * (late - early)
            place_at(box, motion, part, rides, centre, moved, rate)
            fill_corners(moved, corners)
            for axis in range(3):
                region[axis] = crop[axis] - speed * reach
                region[3 + axis] = crop[3 + axis] + speed * reach
            if is_apart(corners, origin, region):
                continue
            window = grown_window(window_of(corners, origin, rotation), speed * reach)
            if window.nearest > beams.reach or not is_between(beams, window):
                continue
            planes = faces.planes[count]
            facing = fill_moving_planes(moved, rate, (origin, rotation), reach, planes)
            faces.part[count], faces.centre[count], faces.facing[count] = part, centre, facing
            if speed == 0.0:
                facing = fill_planes(box, origin, rotation, fixed)
                if facing > 0:
                    meet_part(beams, window, (count, facing, fixed), memory[0], nearest)
            elif facing > 0:
                piece = pieces[n], centre
                _meet(beams, window, (planes, count), (moments, piece), memory, nearest)
            count += 1
    _fill_hits(rays, surfaces, faces, moments, hits)


@inlined
def _cut(beams, moments, cuts, window, pieces):
    """Fill pieces of the scan at which a part may be in a window; return their number.

    Of each its first and past the last step, and its first and last moment, shape (n, 4). `cuts`
    are the largest moment, the speed and the yaw rate of the part at most, and the step at the
    seam. What does not move is in one piece."""
    half, speed, turn, seam = cuts
    count = 0
    if len(beams.aimed) or speed == 0.0:
        count = _pieces_of(turn * 2.0 * half)
        for n in range(count):
            early, late = 2.0 * n / count - 1.0, 2.0 * (n + 1) / count - 1.0
            pieces[n, 0], pieces[n, 1], pieces[n, 2], pieces[n, 3] = 0, 1, half * early, half * late
        return count
    for first, last in runs(beams, 0, window):
        for start, end in ((first, min(last, seam)), (max(first, seam), last)):
            size = end - start
            if size <= 0:
                continue
            number = _pieces_of(turn * abs(moments[0, end - 1] - moments[0, start]))
            for n in range(min(number, size)):
                a, b = start + size * n // number, start + size * (n + 1) // number
                one, other = moments[0, a], moments[0, b - 1]
                pieces[count, 0], pieces[count, 1] = a, b
                pieces[count, 2], pieces[count, 3] = min(one, other), max(one, other)
                count += 1
    return count


@inlined
def _pieces_of(turn):
    return int(min(1.0 + turn / MOST_TURN, _MOST_PIECES))


@inlined
def _distance(planes, k, t):
    """Return the distance of the sensor outside of a plane, never 0."""
    distance = planes[k, 6] + t * planes[k, 7]
    return distance if abs(distance) > 1e-290 else 1e-290


@inlined
def _meet(beams, window, face, when, memory, nearest):
    """Let the rays of a piece of the scan that enter a part meet it where nothing nearer is met."""
    (planes, number), (moments, (piece, centre)) = face, when
    beams_within = beams_in(beams, window)
    if len(beams.aimed) == 0:
        low, top, times = int(piece[0]), int(piece[1]), moments[0]
        for first, last in runs(beams, 0, window):
            # Further steps make whole vectors.
            steps = max(first & ~7, low), min((last + 7) & ~7, top)
            rays = beams_within, steps, times
            _meet_beams(beams, window, rays, (planes, number, centre), memory, nearest)
        return
    for beam in range(beams_within[0], beams_within[1]):
        elevation, t = beams.elevations[beam, 0], moments[beam, 0]
        if window.lowest <= elevation <= window.highest and piece[2] <= t <= piece[3]:
            ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
            cosine, sine = beams.azimuths[beam, 0, 0], beams.azimuths[beam, 1, 0]
            ray, met = (ce * cosine, ce * sine, se), nearest.inverse[beam]
            inverse = _enter_once(planes, t - centre, ray, met)
            if inverse > met:
                nearest.inverse[beam], nearest.part[beam] = inverse, number


@inlined
def _toward(planes, k, t, ray):
    """Return the cosine of a ray with the inward normal of a plane."""
    x, y = planes[k, 0] + t * planes[k, 3], planes[k, 1] + t * planes[k, 4]
    return ray[0] * x + ray[1] * y + ray[2] * (planes[k, 2] + t * planes[k, 5])


@inlined
def _enter_once(planes, t, ray, nearest):
    """Return the inverse distance at which a ray enters a part; -1.0 if not above `nearest`."""
    enter = np.inf
    for k in range(6):
        distance = _distance(planes, k, t)
        if distance > 0.0:
            enter = min(enter, _toward(planes, k, t, ray) / distance)
    if not nearest < enter < np.inf:
        return -1.0
    for k in range(6):
        distance = _distance(planes, k, t)
        if distance < 0.0 and _toward(planes, k, t, ray) < enter * distance:
            return -1.0  # it has left the part before
    return enter


@inlined
def _meet_beams(beams, window, rays, face, memory, nearest):
    """Let the steps of some beams, from first to past the last, meet a part.

    Runs of steps in which the sensor stays on the same side of each plane are met at once."""
    ((start, stop), (first, end), times), (planes, number, centre) = rays, face
    inverses, numbers = nearest
    cosines, sines = along(beams, start)
    while first < end:
        last = _same_sides(planes, times, centre, first, end)
        facing = _fill_lines(planes, cosines, sines, times, centre, (first, last), memory)
        for beam in range(start, stop if facing > 0 else start):
            if not window.lowest <= beams.elevations[beam, 0] <= window.highest:
                continue
            ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
            _enter(memory, facing, ce, se, (first, last))
            row = np.uint64(beam * beams.azimuths.shape[2])
            for n in range(np.uint64(first), np.uint64(last)):
                nearer = memory[12, n] > inverses[row + n]
                inverses[row + n] = memory[12, n] if nearer else inverses[row + n]
                numbers[row + n] = number if nearer else numbers[row + n]
        first = last


@inlined
def _same_sides(planes, times, centre, first, end):
    """Return the end of the steps from `first` on at which the same planes face the sensor."""
    last = end
    for k in range(6):
        side = _distance(planes, k, times[first] - centre) > 0.0
        if (_distance(planes, k, times[last - 1] - centre) > 0.0) != side:
            n = first + 1
            while (_distance(planes, k, times[n] - centre) > 0.0) == side:
                n += 1
            last = n
    return last


@inlined
def _fill_lines(planes, cosines, sines, times, centre, ends, lines):
    """Fill a and b of each plane, those that face the sensor first; return how many do."""
    first, last = np.uint64(ends[0]), np.uint64(ends[1])
    facing, others = 0, 6
    for k in range(6):
        x, y, z = planes[k, 0], planes[k, 1], planes[k, 2]
        vx, vy, vz, change = planes[k, 3], planes[k, 4], planes[k, 5], planes[k, 7]
        if _distance(planes, k, times[first] - centre) > 0.0:
            row = facing
            facing += 1
        else:
            others -= 1
            row = others
        if vx == vy == vz == change == 0.0:  # as of top and bottom
            inverse = 1.0 / _distance(planes, k, 0.0)
            x, y, z = x * inverse, y * inverse, z * inverse
            for n in range(first, last):
                lines[row, n], lines[6 + row, n] = x * cosines[n] + y * sines[n], z
            continue
        for n in range(first, last):
            t = times[n] - centre
            inverse = 1.0 / _distance(planes, k, t)
            across = (x + t * vx) * cosines[n] + (y + t * vy) * sines[n]
            lines[row, n], lines[6 + row, n] = across * inverse, (z + t * vz) * inverse
    return facing


@inlined
def _enter(lines, facing, ce, se, ends):
    """Fill the inverse distances at which rays of a beam enter a part; negative: they miss it.

    They are in the last row of the lines."""
    first, last = np.uint64(ends[0]), np.uint64(ends[1])
    for k in range(6):
        if k == 0:
            for n in range(first, last):
                lines[12, n] = ce * lines[k, n] + se * lines[6 + k, n]
        elif k < facing:
            for n in range(first, last):
                lines[12, n] = min(lines[12, n], ce * lines[k, n] + se * lines[6 + k, n])
        else:
            for n in range(first, last):
                leave = ce * lines[k, n] + se * lines[6 + k, n]
                lines[12, n] = lines[12, n] if lines[12, n] >= leave else -1.0


@inlined
def _fill_hits(rays, surfaces, faces, moments, hits):
    """Turn what every ray meets, inverse distance and number, into range, owner and light.

    Neighbours that meet the same are one run, whose loops are vector code."""
    beams, high, (ranges, targets, reflected) = rays.beams, height_over_ground(rays, True), hits
    steps = beams.azimuths.shape[2]
    inverse, least = np.empty(steps), np.empty(steps)
    for beam in range(len(beams.elevations)):
        row, aim = np.uint64(beam * steps), beam if len(beams.aimed) else 0
        for n in range(np.uint64(steps)):
            inverse[n], target = ranges[row + n], targets[row + n]
            ranges[row + n] = np.inf if target == NOTHING else 1.0 / inverse[n]
            reflected[row + n] = min(inverse[n] * high, 1.0) if target == GROUND else 0.0
        last = 0
        while last < steps:
            first, face = last, targets[row + np.uint64(last)]
            last = _end_of_run(targets, row, first, steps)
            if face < 0:
                continue
            run = beam, aim, first, last
            _fill_light(faces, face, beams, run, (moments, inverse, least), reflected)
            part = faces.part[face]
            owner, bright = surfaces.owner[part], surfaces.reflectivity[part]
            for n in range(row + np.uint64(first), row + np.uint64(last)):
                targets[n], reflected[n] = owner, min(reflected[n], 1.0) * bright


@inlined
def _end_of_run(values, row, first, end):
    """Return the end of equal values of a row from `first` on, by blocks as long as these last."""
    value, last = values[row + np.uint64(first)], first + 1
    while last + _BLOCK <= end:
        start, same = row + np.uint64(last), True
        for n in range(np.uint64(_BLOCK)):
            same &= values[start + n] == value
        if not same:
            break
        last += _BLOCK
    while last < end and values[row + np.uint64(last)] == value:
        last += 1
    return last


@inlined
def _fill_light(faces, face, beams, run, rows, light):
    """Fill the cosines of incidence of a run of rays on a part.

    They are of the plane that the ray meets where it enters: of those that face the sensor and are
    not beyond. The run are the beam, its row of azimuths, and the first and past the last step;
    `least` is memory."""
    planes, azimuths, centre = faces.planes, beams.azimuths, faces.centre[face]
    (beam, aim, first, last), (moments, inverse, least) = run, rows
    ce, se = beams.elevations[beam, 1], beams.elevations[beam, 2]
    row, first, last = np.uint64(beam * azimuths.shape[2]), np.uint64(first), np.uint64(last)
    for n in range(first, last):
        least[n] = np.inf
    for k in range(faces.facing[face]):
        x, y, z = planes[face, k, 0], planes[face, k, 1], planes[face, k, 2]
        vx, vy, vz = planes[face, k, 3], planes[face, k, 4], planes[face, k, 5]
        start, change = planes[face, k, 6], planes[face, k, 7]
        for n in range(first, last):
            t = moments[aim, n] - centre
            across = (x + t * vx) * azimuths[aim, 0, n] + (y + t * vy) * azimuths[aim, 1, n]
            cosine, distance = ce * across + se * (z + t * vz), start + t * change
            beyond = cosine - inverse[n] * distance
            nearer = (distance > 0.0) & (beyond < least[n])
            least[n] = beyond if nearer else least[n]
            light[row + n] = cosine if nearer else light[row + n]

"""Compiled parts of the exact coverage by cones, see `cone.py`.

Lengths are metres in the frame of the grid, relative to the sensor. `n = (n0, n1, n2)` is the
sensor's axis with n2 >= 0, `s` the sine of a beam's elevation."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit

TILE_X, TILE_Y = 16, 32
"""Columns of a tile. Loops over TILE_Y have a fixed length, so that they become vector code."""
_LINES_Y = TILE_Y + 8  # grid lines of a tile, and more to make whole vectors
_HAIR = 1e-9  # cubes are grown by this share of their edge
_ULPS = 4e-16  # rounding of a sine: no beam may slip between two voxels
_BLOCK = 4  # columns along each side of what is decided at once within a tile
_RUN = 8  # voxels of a column that are decided at once; a divisor of 64
_LEAST_K = 1e-2  # a cone with a smaller n2^2 - s^2 is too steep to be computed as a graph


class Sensor(NamedTuple):
    """A turning LiDAR: position (3,), axes x, y, z as rows (3, 3), sines of the elevations, sorted,
    field of view (2,), and range."""

    origin: NDArray[np.float64]
    frame: NDArray[np.float64]
    sines: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    reach: float


class Columns(NamedTuple):
    """A grid of columns of voxels.

    Attributes:
        minimum, resolution, nz: lower corner, edge of a voxel, voxels of a column.
        lowest, highest: voxels of each tile that matter, shape (tiles in x, tiles in y); none where
            highest < lowest. Others may be set or not.
    """

    minimum: NDArray[np.float64]
    resolution: float
    nz: int
    lowest: NDArray[np.int32]
    highest: NDArray[np.int32]


class _View(NamedTuple):
    """What of a cone is seen, in numbers alone, as arrays cost more to hand on than to use: axis of
    the sensor, normals of the two planes that bound the field of view, towards the inside, its
    width, and the range. Points and corners of boxes are tuples for the same reason."""

    n: tuple[float, float, float]
    first: tuple[float, float, float]
    last: tuple[float, float, float]
    width: float
    reach: float


@inner
def _view_of(sensor):
    u, v, n = sensor.frame[0], sensor.frame[1], sensor.frame[2]
    start, end = sensor.azimuth
    c, s = math.cos(start), math.sin(start)
    first = (v[0] * c - u[0] * s, v[1] * c - u[1] * s, v[2] * c - u[2] * s)
    c, s = math.cos(end), math.sin(end)
    last = (u[0] * s - v[0] * c, u[1] * s - v[1] * c, u[2] * s - v[2] * c)
    return _View((n[0], n[1], n[2]), first, last, end - start, sensor.reach)


@inner
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def _corner(start, line, resolution, grow):
    """Where three grid lines meet, and a hair further."""
    (i, j, k), r = line, resolution
    return start[0] + i * r + grow, start[1] + j * r + grow, start[2] + k * r + grow


@inner
def _box(start, first, end, resolution, grow):
    """Lower and upper corner of a box that reaches from grid lines to others, a hair further."""
    return _corner(start, first, resolution, -grow), _corner(start, end, resolution, grow)


@inner
def _edge(a, e, n, least, most):
    """Widen (least, most) by f = n.d/|d| at the start and the stationary point of d = a + t e."""
    na, aa = _dot(n, a), _dot(a, a)
    if aa > 0:
        f = na / math.sqrt(aa)
        least, most = min(least, f), max(most, f)
    ne, ae, ee = _dot(n, e), _dot(a, e), _dot(e, e)
    numerator = na * ae - ne * aa
    denominator = ne * ae - na * ee
    # The stationary point is inside the edge when 0 < numerator / denominator < 1.
    if denominator < 0:
        numerator, denominator = -numerator, -denominator
    if 0 < numerator < denominator:
        t = numerator / denominator
        d = (a[0] + t * e[0], a[1] + t * e[1], a[2] + t * e[2])
        dd = _dot(d, d)
        if dd > 0:
            f = _dot(n, d) / math.sqrt(dd)
            least, most = min(least, f), max(most, f)
    return least, most


@inner
def _segment_meets(low, high, d, length):
    """Whether the segment from the sensor along the unit vector d meets the box."""
    near, far = 0.0, length
    for a, b, along in ((low[0], high[0], d[0]), (low[1], high[1], d[1]), (low[2], high[2], d[2])):
        if along == 0:
            if a > 0 or b < 0:
                return False
        else:
            t0, t1 = a / along, b / along
            near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    return near <= far


@inner
def _sine_range(low, high, n):
    """Range of n.d/|d| over a box, relative to the sensor."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    if x0 <= 0 <= x1 and y0 <= 0 <= y1 and z0 <= 0 <= z1:
        return -1.0, 1.0
    least, most = math.inf, -math.inf
    # Twelve edges; their starts and the two last corners make the eight corners.
    for y in (y0, y1):
        for z in (z0, z1):
            least, most = _edge((x0, y, z), (x1 - x0, 0.0, 0.0), n, least, most)
    for x in (x0, x1):
        for z in (z0, z1):
            least, most = _edge((x, y0, z), (0.0, y1 - y0, 0.0), n, least, most)
    for x in (x0, x1):
        for y in (y0, y1):
            least, most = _edge((x, y, z0), (0.0, 0.0, z1 - z0), n, least, most)
    for z in (z0, z1):
        least, most = _edge((x1, y1, z), (0.0, 0.0, 0.0), n, least, most)
    if _segment_meets(low, high, n, math.inf):
        most = 1.0
    if _segment_meets(low, high, (-n[0], -n[1], -n[2]), math.inf):
        least = -1.0
    return least - _ULPS, most + _ULPS


@inner
def _between(sines, low, high):
    """First and past the last of the sorted sines within [low, high]."""
    first = 0
    while first < len(sines) and sines[first] < low:
        first += 1
    last = first
    while last < len(sines) and sines[last] <= high:
        last += 1
    return first, last


# The part of a cone that a sensor sees: azimuths of its field of view, up to its range.


@inner
def _seen(d, view):
    """Whether a point is within range and field of view."""
    if _dot(d, d) > view.reach * view.reach:
        return False
    if view.width >= 2 * math.pi:
        return True
    first, last = _dot(view.first, d) >= 0, _dot(view.last, d) >= 0
    return (first and last) if view.width <= math.pi else (first or last)


@inner
def _side_of_view(low, high, view):
    """1: all of the box is in range and field of view; -1: nothing of it; 0: not decided."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    nearest = (max(x0, -x1, 0.0), max(y0, -y1, 0.0), max(z0, -z1, 0.0))
    if _dot(nearest, nearest) > view.reach * view.reach:
        return -1
    farthest = (max(-x0, x1), max(-y0, y1), max(-z0, z1))
    inside = _dot(farthest, farthest) <= view.reach * view.reach
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


@inner
def _side_of_plane(low, high, normal):
    """Whether some and whether all of a box is on the inner side of a plane through the sensor."""
    (x0, y0, z0), (x1, y1, z1), (a, b, c) = low, high, normal
    middle = (a * (x0 + x1) + b * (y0 + y1) + c * (z0 + z1)) / 2
    half = (abs(a) * (x1 - x0) + abs(b) * (y1 - y0) + abs(c) * (z1 - z0)) / 2
    return middle + half >= 0, middle - half >= 0


@inner
def _arc_meets(low, high, s, sensor):
    """Whether the arc on which a beam ends at its range meets the box. A coordinate of the arc is m
    + r cos(a - phi). Where the arc enters or leaves the box one is on a face; an arc that does
    neither is wholly inside or outside."""
    _, frame, _, azimuth, reach = sensor
    middle, extent = -s * reach, _HAIR * reach  # the circle is on the plane n.d = s reach
    for axis in range(3):
        middle += 0.5 * frame[2, axis] * (low[axis] + high[axis])
        extent += 0.5 * abs(frame[2, axis]) * (high[axis] - low[axis])
    if abs(middle) > extent:
        return False
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
    slack = 0.5 * _HAIR * (high[0] - low[0])  # the point computed is on the arc up to rounding
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
    """Whether an edge of the box crosses the part of the cone that is seen."""
    n = view.n
    for axis in range(3):
        other, third = (axis + 1) % 3, (axis + 2) % 3
        for p in (low[other], high[other]):
            for q in (low[third], high[third]):
                # (A + n w)^2 = s^2 (B + w^2) for the coordinate w along the edge.
                along, aside = n[other] * p + n[third] * q, p * p + q * q  # A and B
                a, b = n[axis] ** 2 - s * s, along * n[axis]
                c = along * along - s * s * aside
                quarter = along * along + a * aside  # b^2 - a c = s^2 times this, not cancelling
                if quarter < 0:
                    continue
                root = -(b + math.copysign(abs(s) * math.sqrt(quarter), b))
                for w in (root / a, c / root):
                    if not low[axis] <= w <= high[axis]:  # also where the root is not finite
                        continue
                    if (along + n[axis] * w) * s < 0:  # the other nappe
                        continue
                    d = (w, p, q) if axis == 0 else (q, w, p) if axis == 1 else (p, q, w)
                    if _seen(d, view):
                        return True
    return False


@inner
def _patch_meets(low, high, s, sensor, view):
    """Whether the seen part of the cone of one beam meets a closed box. The part is bounded by the
    rays at the ends of the field of view and by the arc at the range. If none of these meets the
    box, a piece of the cone in it is seen as a whole or not at all. It reaches the faces along its
    rulings; there it ends at an edge of the box, or is a closed curve about the axis, which the
    first ray meets."""
    if _edge_crosses(low, high, s, view):
        return True
    cosine, (u, v, n) = math.sqrt(1 - s * s), sensor.frame
    for angle in sensor.azimuth:
        ca, sa = cosine * math.cos(angle), cosine * math.sin(angle)
        dx, dy = ca * u[0] + sa * v[0] + s * n[0], ca * u[1] + sa * v[1] + s * n[1]
        if _segment_meets(low, high, (dx, dy, ca * u[2] + sa * v[2] + s * n[2]), view.reach):
            return True
    d = (max(-low[0], high[0]), max(-low[1], high[1]), max(-low[2], high[2]))
    if _dot(d, d) <= view.reach * view.reach:  # the arc is beyond
        return False
    return _arc_meets(low, high, s, sensor)


@inner
def _near_beams(middle, half, sines, n):
    """First and past the last of the sines that a cube may hold."""
    away = math.sqrt(_dot(middle, middle))
    if away <= 2.0 * half:
        return 0, len(sines)
    spread = 3.0 * half / away  # no sine within the cube is farther from that of its middle
    return _between(sines, _dot(n, middle) / away - spread, _dot(n, middle) / away + spread)


@inner
def _corners_span(middle, half, beams, sines, view):
    """Whether a cone of `sines[beams[0]:beams[1]]` passes between corners of a cube that are seen.
    What of the cube is in range and on the inner side of a plane is convex: a cone that has two
    points of it on either side meets it."""
    # The corner that is farthest inside the nearer plane comes first, then the one above or below.
    (x, y, z), whole = middle, view.width >= 2 * math.pi
    nearer = view.first if _dot(view.first, middle) < _dot(view.last, middle) else view.last
    dx, dy = math.copysign(half, nearer[0]), math.copysign(half, nearer[1])
    for b in range(beams[0], beams[1]):
        by_square = sines[b] * abs(sines[b])
        first_above = first_below = last_above = last_below = False
        for i in range(8):
            cx, cy = x - dx if i & 4 else x + dx, y - dy if i & 2 else y + dy
            d = (cx, cy, z + half if i & 1 else z - half)
            along, square = _dot(view.n, d), _dot(d, d)
            side = along * abs(along) - by_square * square  # has the sign of n.d - s |d|
            near = square <= view.reach * view.reach
            in_first = near and (whole or _dot(view.first, d) >= 0)
            in_last = near and (whole or _dot(view.last, d) >= 0)
            if view.width <= math.pi:
                in_first = in_last = in_first and in_last
            first_above |= in_first and side >= 0
            first_below |= in_first and side <= 0
            last_above |= in_last and side >= 0
            last_below |= in_last and side <= 0
            if (first_above and first_below) or (last_above and last_below):
                return True
    return False


# Runs of voxels in the columns of a tile. `scratch` holds a bit a voxel, shape
# (words, TILE_X * TILE_Y).


@inner
def _set_run(scratch, row, column, one_end, other_end, slack, nz):
    """Set the voxels between two heights, in voxels."""
    low, high = min(one_end, other_end) - slack, max(one_end, other_end) + slack
    if high < 0 or low >= nz:
        return
    for k in range(int(max(low, 0.0)), int(min(high, nz - 1.0)) + 1):
        scratch[k >> 6, row * TILE_Y + column] |= np.uint64(1) << np.uint64(k & 63)


@inner
def _add_level_beam(near, far, s, bottom, resolution, nz, words, scratch):
    """Add the run of every column for a beam of a sensor that is not tilted. The height is
    tan(elevation) times the distance from the axis, `near` to `far` over the square of a column,
    shape (TILE_X * TILE_Y,)."""
    one, two, zero = np.uint64(1), np.uint64(2), np.uint64(0)
    slope = s / math.sqrt(1 - s * s) / resolution
    slack = _HAIR * (1 + abs(slope) * resolution * math.sqrt(2.0))
    closest, farthest = (near, far) if s >= 0 else (far, near)
    for word in range(words[0], words[1] + 1):
        target = scratch[word]
        offset = bottom / resolution + 64.0 * word
        below, above = offset + slack, offset - slack
        end = min(nz - 64.0 * word, 64.0)
        top = end - 1.0
        for c in range(TILE_X * TILE_Y):
            low, high = slope * closest[c] - below, slope * farthest[c] - above
            hit = (low < end) & (high >= 0.0)
            low = min(max(low, 0.0), top)
            high = min(max(high, 0.0), top)
            run = (two << np.uint64(np.int32(high))) - (one << np.uint64(np.int32(low)))
            target[c] |= run if hit else zero


@inner
def _add_tilted_beam(tile, axis, s, words, lines, scratch):
    """Add the run of every column for a beam of a tilted sensor. The height is homogeneous of
    degree one in (x, y), and convex or concave. Over a square its extremes are at the corners, at
    the apex, and at the one stationary point of the height along each grid line. The few squares
    that hold such a point are widened one by one."""
    xs, ys, rows, columns, bottom, resolution, nz = tile  # lines of the grid, from `bottom` up
    n0, n1, n2 = axis
    one, two, zero = np.uint64(1), np.uint64(2), np.uint64(0)
    k = n2 * n2 - s * s
    scale = 1 / (k * resolution)
    by_root, by_tilt = s * scale, n2 * scale
    offset = bottom / resolution
    # The gradient is nowhere steeper than the tilt and the elevation together.
    tilt, level = math.hypot(n0, n1), math.sqrt(1 - s * s)
    steepest = (tilt * level + n2 * abs(s)) / (n2 * level - tilt * abs(s))
    slack = _HAIR * (1 + steepest * math.sqrt(2.0))
    for line in range(rows + 1):
        x = xs[line]
        before, after = lines[(line + 1) % 2], lines[line % 2]
        kxx, n0x = k * x * x, n0 * x
        for c in range(_LINES_Y):
            a = n0x + n1 * ys[c]
            after[c] = by_root * math.sqrt(a * a + kxx + k * ys[c] * ys[c]) - by_tilt * a - offset
        if line == 0:
            continue
        for word in range(words[0], words[1] + 1):
            below, above = 64.0 * word + slack, 64.0 * word - slack
            end = min(nz - 64.0 * word, 64.0)
            top = end - 1.0
            target = scratch[word, (line - 1) * TILE_Y : line * TILE_Y]
            for c in range(TILE_Y):
                low = min(min(before[c], after[c]), min(before[c + 1], after[c + 1]))
                high = max(max(before[c], after[c]), max(before[c + 1], after[c + 1]))
                low -= below
                high -= above
                hit = (low < end) & (high >= 0.0)
                low = min(max(low, 0.0), top)
                high = min(max(high, 0.0), top)
                run = (two << np.uint64(np.int32(high))) - (one << np.uint64(np.int32(low)))
                target[c] |= run if hit else zero
    # With |n| = 1, dz/dy = 0 on x = const where
    # (n1^2 + k) y + n0 n1 x = sign(s n1) n2 |n1 x| sqrt((1 - s^2) / (s^2 - n1^2));
    # the same on y = const with n0 and n1, x and y exchanged.
    for on_x in (True, False):
        here, there, lines_here, most = (xs, ys, rows, columns) if on_x else (ys, xs, columns, rows)
        m, n = (n0, n1) if on_x else (n1, n0)
        if s * s <= n * n:
            continue
        turn = math.copysign(1.0, s) * n * n2 * math.sqrt((1 - s * s) / (s * s - n * n))
        for line in range(lines_here + 1):
            x = here[line]
            y = (turn * abs(x) - n0 * n1 * x) / (n * n + k)
            if there[0] < y < there[most]:
                c = min(int((y - there[0]) / resolution), most - 1)
                turning = _height(x, y, k, m, n, by_root, by_tilt) - offset
                corner = _height(x, there[c], k, m, n, by_root, by_tilt) - offset
                for row in range(max(line - 1, 0), min(line + 1, lines_here)):
                    i, j = (row, c) if on_x else (c, row)
                    _set_run(scratch, i, j, turning, corner, slack, nz)
    if xs[0] <= 0 <= xs[rows] and ys[0] <= 0 <= ys[columns]:
        row = min(int(-xs[0] / resolution), rows - 1)
        c = min(int(-ys[0] / resolution), columns - 1)
        corner = _height(xs[row], ys[c], k, n0, n1, by_root, by_tilt) - offset
        _set_run(scratch, row, c, -offset, corner, slack, nz)


@inner
def _height(x, y, k, n0, n1, by_root, by_tilt):
    """Height of the cone over (x, y), in voxels above the sensor."""
    a = n0 * x + n1 * y
    return by_root * math.sqrt(a * a + k * (x * x + y * y)) - by_tilt * a


@inner
def _add_steep_beams(tile, axis, k0, k1, sines, graphs, scratch):
    """Test the beams but `sines[graphs[0]:graphs[1]]`, whose cone is no graph, by voxel."""
    xs, ys, rows, columns, bottom, resolution, _ = tile
    grow = _HAIR * resolution
    for row in range(rows):
        for c in range(columns):
            # The whole column first, then each of its voxels.
            for k in range(k0 - 1, k1 + 1):
                first, last = (k0, k1 + 1) if k < k0 else (k, k + 1)
                low = (xs[row] - grow, ys[c] - grow, bottom + first * resolution - grow)
                high = (xs[row + 1] + grow, ys[c + 1] + grow, bottom + last * resolution + grow)
                found = _steep_between(sines, graphs, *_sine_range(low, high, axis))
                if k < k0 and not found:
                    break
                if k >= k0 and found:
                    scratch[k >> 6, row * TILE_Y + c] |= np.uint64(1) << np.uint64(k & 63)


@inner
def _steep_between(sines, graphs, low, high):
    """Whether a sine outside `sines[graphs[0]:graphs[1]]` lies within [low, high]."""
    first, last = _between(sines, low, high)
    return first < last and (first < graphs[0] or last > graphs[1])


@njit(cache=True, nogil=True, error_model="numpy")
def cover_tiles(sensor, grid, bits):
    """Set in `bits` (words, nx, ny) the voxels of `Columns` that the beams of a `Sensor` with
    `frame[2, 2] >= 0` cover, by columns. Range and field of view only leave out whole tiles."""
    origin, frame, sines, _, _ = sensor
    minimum, resolution, nz, lowest, highest = grid
    words, nx, ny = bits.shape
    n0, n1, n2 = frame[2]
    grow = _HAIR * resolution
    bottom = minimum[2] - origin[2]
    xs, ys = np.empty(TILE_X + 1), np.empty(_LINES_Y)
    near, far = np.empty(TILE_X * TILE_Y), np.empty(TILE_X * TILE_Y)
    lines = np.empty((2, _LINES_Y))
    scratch = np.empty((words, TILE_X * TILE_Y), np.uint64)
    view = _view_of(sensor)
    level = n0 == 0 and n1 == 0
    steepest = math.sqrt(max(n2 * n2 - _LEAST_K, 0.0))
    graphs = _between(sines, -steepest, steepest)
    for tile_x in range(lowest.shape[0]):
        i0 = tile_x * TILE_X
        rows = min(nx - i0, TILE_X)
        for line in range(TILE_X + 1):
            xs[line] = minimum[0] + (i0 + line) * resolution - origin[0]
        for tile_y in range(lowest.shape[1]):
            k0, k1 = lowest[tile_x, tile_y], highest[tile_x, tile_y]
            if k1 < k0:
                continue
            j0 = tile_y * TILE_Y
            columns = min(ny - j0, TILE_Y)
            for line in range(_LINES_Y):
                ys[line] = minimum[1] + (j0 + line) * resolution - origin[1]
            low = (xs[0] - grow, ys[0] - grow, bottom + k0 * resolution - grow)
            high = (xs[rows] + grow, ys[columns] + grow, bottom + (k1 + 1) * resolution + grow)
            if _side_of_view(low, high, view) < 0:
                continue
            first, last = _between(sines, *_sine_range(low, high, view.n))
            if first == last:
                continue
            for word in range(words):
                for c in range(TILE_X * TILE_Y):
                    scratch[word, c] = 0
            needed = k0 >> 6, k1 >> 6
            tile = xs, ys, rows, columns, bottom, resolution, nz
            if level:
                _distances(xs, ys, near, far)
            for b in range(max(first, graphs[0]), min(last, graphs[1])):
                if level:
                    _add_level_beam(near, far, sines[b], bottom, resolution, nz, needed, scratch)
                else:
                    _add_tilted_beam(tile, view.n, sines[b], needed, lines, scratch)
            if first < graphs[0] or last > graphs[1]:
                _add_steep_beams(tile, view.n, k0, k1, sines, graphs, scratch)
            for word in range(words):
                for row in range(rows):
                    for c in range(columns):
                        bits[word, i0 + row, j0 + c] = scratch[word, row * TILE_Y + c]


@inner
def _distances(xs, ys, near, far):
    """Least and largest distance from the axis over the square of every column of a tile."""
    for row in range(TILE_X):
        least_x = max(xs[row], -xs[row + 1], 0.0)
        most_x = max(-xs[row], xs[row + 1])
        for c in range(TILE_Y):
            least_y = max(max(ys[c], -ys[c + 1]), 0.0)
            most_y = max(-ys[c], ys[c + 1])
            near[row * TILE_Y + c] = math.sqrt(least_x * least_x + least_y * least_y)
            far[row * TILE_Y + c] = math.sqrt(most_x * most_x + most_y * most_y)


@njit(cache=True, nogil=True, error_model="numpy")
def keep_seen(sensor, grid, bits):
    """Clear the bits that range and field of view exclude; arguments of `cover_tiles`."""
    minimum, resolution, _, lowest, highest = grid
    _, nx, ny = bits.shape
    grow, start, view = _HAIR * resolution, minimum - sensor.origin, _view_of(sensor)
    for tile_x in range(lowest.shape[0]):
        for tile_y in range(lowest.shape[1]):
            k0, k1 = np.int64(lowest[tile_x, tile_y]), np.int64(highest[tile_x, tile_y])
            if k1 < k0:
                continue
            i0, j0 = tile_x * TILE_X, tile_y * TILE_Y
            i1, j1 = min(i0 + TILE_X, nx), min(j0 + TILE_Y, ny)
            low, high = _box(start, (i0, j0, k0), (i1, j1, k1 + 1), resolution, grow)
            if _side_of_view(low, high, view) != 0:
                continue  # none of it is there to be cleared
            for block_i in range(i0, i1, _BLOCK):
                for block_j in range(j0, j1, _BLOCK):
                    end_i, end_j = min(block_i + _BLOCK, i1), min(block_j + _BLOCK, j1)
                    first, end = (block_i, block_j, k0), (end_i, end_j, k1 + 1)
                    low, high = _box(start, first, end, resolution, grow)
                    side = _side_of_view(low, high, view)
                    if side < 0:
                        bits[:, block_i:end_i, block_j:end_j] = 0
                    if side == 0:
                        _keep_seen_in(first, end, sensor, view, start, resolution, bits)


@inner
def _keep_seen_in(first, end, sensor, view, start, resolution, bits):
    """`keep_seen` voxel by voxel: most are decided by their run, their box or their corners."""
    (i0, j0, k0), (i1, j1, k1), sines = first, end, sensor.sines
    grow = _HAIR * resolution
    half = 0.5 * resolution + grow
    for i in range(i0, i1):
        for j in range(j0, j1):
            for run in range(k0 // _RUN * _RUN, k1, _RUN):
                mask = np.uint64((1 << _RUN) - 1) << np.uint64(run & 63)
                if not bits[run >> 6, i, j] & mask:
                    continue
                low, high = _box(start, (i, j, run), (i + 1, j + 1, run + _RUN), resolution, grow)
                side = _side_of_view(low, high, view)
                if side < 0:
                    bits[run >> 6, i, j] &= ~mask
                if side != 0:
                    continue
                for k in range(run, run + _RUN):
                    bit = np.uint64(1) << np.uint64(k & 63)
                    if not bits[run >> 6, i, j] & bit:
                        continue
                    low, high = _box(start, (i, j, k), (i + 1, j + 1, k + 1), resolution, grow)
                    side = _side_of_view(low, high, view)
                    if side == 0:
                        x, y = start[0] + (i + 0.5) * resolution, start[1] + (j + 0.5) * resolution
                        middle = (x, y, start[2] + (k + 0.5) * resolution)
                        beams = _near_beams(middle, half, sines, view.n)
                        if _corners_span(middle, half, beams, sines, view):
                            continue
                        for b in range(beams[0], beams[1]):
                            if _patch_meets(low, high, sines[b], sensor, view):
                                side = 1
                                break
                    if side <= 0:
                        bits[run >> 6, i, j] ^= bit


@njit(cache=True, nogil=True, error_model="numpy")
def cover_voxels(sensor, minimum, resolution, covered):
    """Set the voxels that the beams of one sensor cover, one by one, in a mask (nx, ny, nz)."""
    view, sines, start = _view_of(sensor), sensor.sines, minimum - sensor.origin
    for i, j, k in np.ndindex(covered.shape):
        end = (i + 1, j + 1, k + 1)
        low, high = _box(start, (i, j, k), end, resolution, _HAIR * resolution)
        side = _side_of_view(low, high, view)
        if covered[i, j, k] or side < 0:
            continue
        first, last = _between(sines, *_sine_range(low, high, view.n))
        for b in range(first, last):
            if side > 0 or _patch_meets(low, high, sines[b], sensor, view):
                covered[i, j, k] = True
                break

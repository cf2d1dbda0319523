"""Coverage by columns: a beam whose cone is a graph over the plane covers one run of each column.

`cover_tiles` goes from tile to tile of columns that matter:

1. skip a tile that is out of view, or in which no beam has its elevation;
2. add the runs of each beam whose cone is a graph: `_add_level_beam` for a sensor that is not
   tilted, else `_add_tilted_beam`;
3. test the beams whose cone is no graph voxel by voxel: `_add_steep_beams`;
4. copy the voxels of the tile to the grid.

`covered` holds the voxels of a tile as bits, shape (words, TILE_X * TILE_Y). Heights are voxels
above the bottom of the grid."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inlined, njit
from lidarplace.coverage.cone_sines import HAIR, sine_range, sines_between
from lidarplace.coverage.cone_view import side_of_view, view_of

TILE_X, TILE_Y = 16, 32
"""Columns of a tile. Loops over TILE_Y have a fixed length, so that they become vector code."""
_LINES_Y = TILE_Y + 8  # grid lines of a tile, and more to make whole vectors
_LEAST_K = 1e-2  # a cone with a smaller n2^2 - s^2 is too steep to be computed as a graph


class Columns(NamedTuple):
    """A grid of columns of voxels.

    Attributes:
        minimum, resolution, nz: lower corner, edge of a voxel, voxels of a column.
        lowest, highest: voxels of each tile that matter, shape (tiles in x, tiles in y); none where
            highest < lowest. Others may be set or not."""

    minimum: NDArray[np.float64]
    resolution: float
    nz: int
    lowest: NDArray[np.int32]
    highest: NDArray[np.int32]


class _Tile(NamedTuple):
    """Columns of a tile, relative to the sensor.

    Attributes:
        xs, ys: grid lines, (TILE_X + 1,) and (_LINES_Y,); some may be beyond the grid.
        rows, columns: columns of the grid along x and y.
        bottom, resolution, nz: bottom of the grid, edge of a voxel, voxels of a column.
        first, last: voxels of a column that matter."""

    xs: NDArray[np.float64]
    ys: NDArray[np.float64]
    rows: int
    columns: int
    bottom: float
    resolution: float
    nz: int
    first: int
    last: int


class _Graph(NamedTuple):
    """The cone of a beam as a graph: `by_root sqrt(a^2 + k (x^2 + y^2)) - by_tilt a - offset`.

    `a = n0 x + n1 y`, `k = n2^2 - s^2`; heights are right up to `slack`."""

    n: tuple[float, float, float]
    s: float
    k: float
    by_root: float
    by_tilt: float
    offset: float
    slack: float


@njit(cache=True, nogil=True, error_model="numpy")
def cover_tiles(sensor, grid, bits):
    """Set in `bits` (words, nx, ny) the voxels of `Columns` that the beams of a `Sensor` cover.

    `frame[2, 2] >= 0` of the sensor. Range and field of view only leave out whole tiles."""
    origin, sines = sensor.origin, sensor.sines
    minimum, resolution, nz, lowest, highest = grid
    words, nx, ny = bits.shape
    view, bottom = view_of(sensor), minimum[2] - origin[2]
    level = view.n[0] == 0 and view.n[1] == 0
    steepest = math.sqrt(max(view.n[2] * view.n[2] - _LEAST_K, 0.0))
    graphs = sines_between(sines, -steepest, steepest)
    xs, ys, heights = np.empty(TILE_X + 1), np.empty(_LINES_Y), np.empty((2, _LINES_Y))
    near, far = np.empty(TILE_X * TILE_Y), np.empty(TILE_X * TILE_Y)
    covered = np.empty((words, TILE_X * TILE_Y), np.uint64)
    for tile_x, tile_y in np.ndindex(lowest.shape):
        k0, k1 = lowest[tile_x, tile_y], highest[tile_x, tile_y]
        if k1 < k0:
            continue
        i0, j0 = tile_x * TILE_X, tile_y * TILE_Y
        rows, columns = min(nx - i0, TILE_X), min(ny - j0, TILE_Y)
        for line in range(TILE_X + 1):
            xs[line] = minimum[0] + (i0 + line) * resolution - origin[0]
        for line in range(_LINES_Y):
            ys[line] = minimum[1] + (j0 + line) * resolution - origin[1]
        tile = _Tile(xs, ys, rows, columns, bottom, resolution, nz, k0, k1)
        low, high = _box_in(tile, (0, 0, k0), (rows, columns, k1 + 1))
        if side_of_view(low, high, view) < 0:
            continue
        first, last = sines_between(sines, *sine_range(low, high, view.n))
        if first == last:
            continue
        for word in range(words):
            for c in range(TILE_X * TILE_Y):
                covered[word, c] = 0
        if level:
            _fill_distances(xs, ys, near, far)
        for b in range(max(first, graphs[0]), min(last, graphs[1])):
            if level:
                _add_level_beam(tile, near, far, sines[b], covered)
            else:
                _add_tilted_beam(tile, view.n, sines[b], heights, covered)
        if first < graphs[0] or last > graphs[1]:
            _add_steep_beams(tile, view.n, sines, graphs, covered)
        for word in range(words):
            for row in range(rows):
                for c in range(columns):
                    bits[word, i0 + row, j0 + c] = covered[word, row * TILE_Y + c]


@inlined
def _box_in(tile, first, end):
    """Return the corners of the voxels of a tile from `first` to before `end`, grown by a hair."""
    (row, c, k), grow = first, HAIR * tile.resolution
    low = tile.xs[row] - grow, tile.ys[c] - grow, tile.bottom + k * tile.resolution - grow
    row, c, k = end
    high = tile.xs[row] + grow, tile.ys[c] + grow, tile.bottom + k * tile.resolution + grow
    return low, high


@inlined
def _run_bits(low, high, end):
    """Return the bits of a word, of which `end` are in the grid, from one height to another."""
    one, two, top = np.uint64(1), np.uint64(2), end - 1.0
    hit = (low < end) & (high >= 0.0)
    low = min(max(low, 0.0), top)
    high = min(max(high, 0.0), top)
    run = (two << np.uint64(np.int32(high))) - (one << np.uint64(np.int32(low)))
    return run if hit else np.uint64(0)


@inlined
def _fill_distances(xs, ys, near, far):
    """Fill least and largest distance from the axis over the square of every column of a tile."""
    for row in range(TILE_X):
        least_x = max(xs[row], -xs[row + 1], 0.0)
        most_x = max(-xs[row], xs[row + 1])
        for c in range(TILE_Y):
            least_y = max(max(ys[c], -ys[c + 1]), 0.0)
            most_y = max(-ys[c], ys[c + 1])
            near[row * TILE_Y + c] = math.sqrt(least_x * least_x + least_y * least_y)
            far[row * TILE_Y + c] = math.sqrt(most_x * most_x + most_y * most_y)


@inlined
def _add_level_beam(tile, near, far, s, covered):
    """Add the run of every column for a beam of a sensor that is not tilted.

    The height is tan(elevation) times the distance from the axis, `near` to `far` over the square
    of a column, shape (TILE_X * TILE_Y,)."""
    slope = s / math.sqrt(1 - s * s) / tile.resolution
    slack = HAIR * (1 + abs(slope) * tile.resolution * math.sqrt(2.0))
    closest, farthest = (near, far) if s >= 0 else (far, near)
    for word in range(tile.first >> 6, (tile.last >> 6) + 1):
        bits = covered[word]
        offset = tile.bottom / tile.resolution + 64.0 * word
        low_offset, high_offset = offset + slack, offset - slack
        end = min(tile.nz - 64.0 * word, 64.0)
        for c in range(TILE_X * TILE_Y):
            bits[c] |= _run_bits(
                slope * closest[c] - low_offset, slope * farthest[c] - high_offset, end
            )


@inlined
def _add_tilted_beam(tile, n, s, heights, covered):
    """Add the run of every column for a beam of a tilted sensor.

    The height is homogeneous of degree one in (x, y), and convex or concave. Over a square its
    extremes are at the corners, at the apex, and at the one stationary point of the height along
    each grid line. The few squares that hold such a point are widened one by one. `heights` is
    memory for those of two grid lines."""
    graph = _graph_of(tile, n, s)
    for line in range(tile.rows + 1):
        before, after = heights[(line + 1) % 2], heights[line % 2]
        _fill_heights(tile, graph, tile.xs[line], after)
        if line > 0:
            _add_between(tile, graph, line - 1, before, after, covered)
    _widen_at_turns(tile, graph, True, covered)
    _widen_at_turns(tile, graph, False, covered)
    _widen_at_apex(tile, graph, covered)


@inlined
def _graph_of(tile, n, s):
    """Return the `_Graph` of a beam."""
    n0, n1, n2 = n
    k = n2 * n2 - s * s
    scale = 1 / (k * tile.resolution)
    # The gradient is nowhere steeper than the tilt and the elevation together.
    tilt, level = math.hypot(n0, n1), math.sqrt(1 - s * s)
    steepest = (tilt * level + n2 * abs(s)) / (n2 * level - tilt * abs(s))
    slack = HAIR * (1 + steepest * math.sqrt(2.0))
    return _Graph(n, s, k, s * scale, n2 * scale, tile.bottom / tile.resolution, slack)


@inlined
def _fill_heights(tile, graph, x, heights):
    """Fill the heights of the cone at the grid points of the line at x."""
    (n0, n1, _), k, ys = graph.n, graph.k, tile.ys
    by_root, by_tilt, offset = graph.by_root, graph.by_tilt, graph.offset
    kxx, n0x = k * x * x, n0 * x
    for c in range(_LINES_Y):
        a = n0x + n1 * ys[c]
        heights[c] = by_root * math.sqrt(a * a + kxx + k * ys[c] * ys[c]) - by_tilt * a - offset


@inlined
def _add_between(tile, graph, row, before, after, covered):
    """Add the runs of a row of columns, between the corners of each: heights on its two lines."""
    for word in range(tile.first >> 6, (tile.last >> 6) + 1):
        low_offset, high_offset = 64.0 * word + graph.slack, 64.0 * word - graph.slack
        end = min(tile.nz - 64.0 * word, 64.0)
        bits = covered[word, row * TILE_Y : (row + 1) * TILE_Y]
        for c in range(TILE_Y):
            low = min(min(before[c], after[c]), min(before[c + 1], after[c + 1]))
            high = max(max(before[c], after[c]), max(before[c + 1], after[c + 1]))
            bits[c] |= _run_bits(low - low_offset, high - high_offset, end)


@inlined
def _widen_at_turns(tile, graph, on_x, covered):
    """Widen the runs of squares with a stationary height on a grid line, x or else y constant.

    With |n| = 1, dz/dy = 0 on x = const where
    `(n1^2 + k) y + n0 n1 x = sign(s n1) n2 |n1 x| sqrt((1 - s^2) / (s^2 - n1^2))`;
    the same on y = const with n0 and n1, x and y exchanged."""
    (n0, n1, n2), s, k = graph.n, graph.s, graph.k
    n_line, n_along = (n0, n1) if on_x else (n1, n0)
    if s * s <= n_along * n_along:
        return
    if on_x:
        lines, points, most_lines, most = tile.xs, tile.ys, tile.rows, tile.columns
    else:
        lines, points, most_lines, most = tile.ys, tile.xs, tile.columns, tile.rows
    turn = (
        math.copysign(1.0, s) * n_along * n2 * math.sqrt((1 - s * s) / (s * s - n_along * n_along))
    )
    for line in range(most_lines + 1):
        x = lines[line]
        y = (turn * abs(x) - n0 * n1 * x) / (n_along * n_along + k)
        if not points[0] < y < points[most]:
            continue
        c = min(int((y - points[0]) / tile.resolution), most - 1)
        turning = _height(x, y, n_line, n_along, graph)
        corner = _height(x, points[c], n_line, n_along, graph)
        for row in range(max(line - 1, 0), min(line + 1, most_lines)):
            column = row * TILE_Y + c if on_x else c * TILE_Y + row
            _set_run(covered, column, turning, corner, graph.slack, tile.nz)


@inlined
def _widen_at_apex(tile, graph, covered):
    """Widen the run of the square that the axis meets: down or up to the apex."""
    xs, ys = tile.xs, tile.ys
    if xs[0] <= 0 <= xs[tile.rows] and ys[0] <= 0 <= ys[tile.columns]:
        row = min(int(-xs[0] / tile.resolution), tile.rows - 1)
        c = min(int(-ys[0] / tile.resolution), tile.columns - 1)
        corner = _height(xs[row], ys[c], graph.n[0], graph.n[1], graph)
        _set_run(covered, row * TILE_Y + c, -graph.offset, corner, graph.slack, tile.nz)


@inlined
def _height(x, y, n0, n1, graph):
    """Return the height of the cone over (x, y)."""
    a = n0 * x + n1 * y
    root = math.sqrt(a * a + graph.k * (x * x + y * y))
    return graph.by_root * root - graph.by_tilt * a - graph.offset


@inlined
def _set_run(covered, column, one_end, other_end, slack, nz):
    """Set the voxels of a column between two heights."""
    low, high = min(one_end, other_end) - slack, max(one_end, other_end) + slack
    if high < 0 or low >= nz:
        return
    for k in range(int(max(low, 0.0)), int(min(high, nz - 1.0)) + 1):
        covered[k >> 6, column] |= np.uint64(1) << np.uint64(k & 63)


@inlined
def _add_steep_beams(tile, n, sines, graphs, covered):
    """Test the beams but `sines[graphs[0]:graphs[1]]`, whose cone is no graph, by voxel."""
    for row in range(tile.rows):
        for c in range(tile.columns):
            # The whole column, then each of its voxels.
            start, end = (row, c, tile.first), (row + 1, c + 1, tile.last + 1)
            if not _steep_in(tile, start, end, n, sines, graphs):
                continue
            for k in range(tile.first, tile.last + 1):
                if _steep_in(tile, (row, c, k), (row + 1, c + 1, k + 1), n, sines, graphs):
                    covered[k >> 6, row * TILE_Y + c] |= np.uint64(1) << np.uint64(k & 63)


@inlined
def _steep_in(tile, start, end, n, sines, graphs):
    """Return whether voxels hold a sine outside `sines[graphs[0]:graphs[1]]`."""
    low, high = _box_in(tile, start, end)
    first, last = sines_between(sines, *sine_range(low, high, n))
    return first < last and (first < graphs[0] or last > graphs[1])

"""Counts of points and rays in the cells around a vehicle.

A cell counts the points in it, the frames that they are of, and the rays that pass through the
middle of where its points are. What is in a labelled box counts as if rays had passed. Cells are in
blocks, which a hash table finds by their keys:

1. `count_points` counts the points of a frame in their cells, and adds blocks for them.
2. `count_passes` follows rays from block to block, and through the cells of each.
3. `static_cells` selects the cells that enough frames hit and that stop enough rays."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.logs.world import BLOCK, CELL_M, HALF_LEVELS, HALF_TILES, TILE

LEAST_SHARE = 0.2  # of the rays at a cell, that it stops; what moves is in a cell for a moment only
REACH_M = 100.0  # points farther from the vehicle are left out: too few hit a cell there
_BEHIND_M = 0.5  # a ray passes a cell if it ends so far behind: it may end at the same surface
_EVERY = 4  # of the rays one in so many is followed to what it passes; in turn
_MANY = 60_000  # counts are halved at this number
_HITS, _PASSES, _LIGHT, _FRAMES, _LAST, _X, _Y, _Z = range(8)


class CellCounts(NamedTuple):
    """Counts of the cells around the vehicle, by blocks in a hash table."""

    table: NDArray[np.int64]  # rows of blocks by hash of their keys, -1 where free
    keys: NDArray[np.int64]  # of the blocks, -1 for a row without one
    free: NDArray[np.int64]  # rows without a block, the first `size[0]` of them
    size: NDArray[np.int64]  # shape (1,)
    cells: NDArray[np.uint16]
    """Points, passes, mean intensity in 1/65280, frames, the last of them, and from where to where
    along x, y and z points are, in 1/256, the upper end in the high byte; shape (rows, 512, 8)."""


def new_counts(rows: int, old: CellCounts | None = None) -> CellCounts:
    """Allocate counts of so many blocks, with those of `old`."""
    cells = np.zeros((rows, BLOCK**3, 8), np.uint16)
    keys, free = np.full(rows, -1, np.int64), np.empty(rows, np.int64)
    new = CellCounts(np.empty(4 * rows, np.int64), keys, free, np.empty(1, np.int64), cells)
    if old is not None:
        new.keys[: len(old.keys)], new.cells[: len(old.keys)] = old.keys, old.cells
    list_rows(new)
    return new


@inner
def _slot(table, keys, key):
    """Find the place in the table where a block is, or would be."""
    slot = np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(20)) % len(table)
    while table[slot] >= 0 and keys[table[slot]] != key:
        slot = slot + np.int64(1) if slot + 1 < len(table) else np.int64(0)
    return slot


@njit(cache=True, nogil=True)
def list_rows(counts):
    """Set the table, and the rows that are free, by the keys."""
    counts.table[:] = -1
    counts.size[0] = 0
    for row in range(len(counts.keys) - 1, -1, -1):
        if counts.keys[row] >= 0:
            counts.table[_slot(counts.table, counts.keys, counts.keys[row])] = row
        else:
            counts.free[counts.size[0]] = row
            counts.size[0] += 1


@inner
def _key(i, j, k):
    tile = (i // TILE + HALF_TILES) * 2 * HALF_TILES + j // TILE + HALF_TILES
    return (tile * TILE**2 + i % TILE * TILE + j % TILE) * 2 * HALF_LEVELS + k + HALF_LEVELS


@njit(cache=True, nogil=True)
def count_points(points, in_box, turn, shift, start, frame, counts):
    """Count points in cells from the `start`-th on; return at which one there is no more room."""
    levels = HALF_LEVELS * BLOCK
    for n in range(start, len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not x * x + y * y + z * z <= REACH_M * REACH_M:
            continue
        u = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + shift[0]
        v = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + shift[1]
        w = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
        i, j, k = math.floor(u), math.floor(v), math.floor(w)
        if not -levels <= k < levels:
            continue
        key = _key(i // BLOCK, j // BLOCK, k // BLOCK)
        slot = _slot(counts.table, counts.keys, key)
        if counts.table[slot] < 0:
            if in_box[n]:
                continue
            if counts.size[0] == 0:
                return n
            counts.size[0] -= 1
            row = counts.free[counts.size[0]]
            counts.table[slot], counts.keys[row] = row, key
        row = counts.table[slot]
        cell = counts.cells[row, (i % BLOCK * BLOCK + j % BLOCK) * BLOCK + k % BLOCK]
        if in_box[n]:
            _count(cell, _PASSES)  # as many rays are not followed, it weighs more
        else:
            _count_hit(cell, (u - i, v - j, w - k), points[n, 3], frame)
    return len(points)


@inner
def _count_hit(cell, shares, intensity, frame):
    """Count a point in a cell, `shares` of whose edges are before it."""
    mark = np.uint16(frame % 2**16)
    if cell[_LAST] != mark or cell[_FRAMES] == 0:
        cell[_LAST] = mark
        if cell[_FRAMES] < _MANY:
            cell[_FRAMES] += np.uint16(1)
    _count(cell, _HITS)
    light = 65280.0 * min(max(intensity, 0.0), 1.0)
    mean = float(cell[_LIGHT])
    cell[_LIGHT] = np.uint16(mean + (light - mean) / cell[_HITS] + 0.5)
    for axis, share in ((_X, shares[0]), (_Y, shares[1]), (_Z, shares[2])):
        cell[axis] = _widened(cell[axis], min(int(share * 256.0), 255), cell[_HITS] == 1)


@inner
def _widened(ends, place, first):
    """Add a place to the range of those along an axis, packed as in `CellCounts`."""
    low, high = (place, place) if first else (np.int64(ends & 255), np.int64(ends >> 8))
    return np.uint16(min(low, place) | max(high, place) << 8)


@inner
def _count(cell, column):
    """Count one more; of large counts only the ratio matters."""
    cell[column] += np.uint16(1)
    if cell[column] >= _MANY:
        cell[_HITS] //= np.uint16(2)
        cell[_PASSES] //= np.uint16(2)


@njit(cache=True, nogil=True, error_model="numpy")
def count_passes(points, lidar, eyes, turn, shift, frame, counts):
    """Count the rays that pass through the middle of what is in a cell."""
    start, way, to_edge, width = np.empty((4, 3))
    block, step = np.empty((2, 3), np.int64)
    behind, reach = _BEHIND_M / CELL_M, REACH_M / CELL_M
    for n in range(frame % _EVERY, len(points), _EVERY):
        length = _ray(eyes[lidar[n]], points[n], turn, shift, start, way)
        end = min(length - behind, reach)
        if not end > 0.0:
            continue
        way /= length
        _enter_first_block(start, way, block, step, to_edge, width)
        t = 0.0
        while t < end:
            leave = min(to_edge[0], to_edge[1], to_edge[2], end)
            if -HALF_LEVELS <= block[2] < HALF_LEVELS:
                key = _key(block[0], block[1], block[2])
                row = counts.table[_slot(counts.table, counts.keys, key)]
                if row >= 0:
                    _pass_block(counts.cells[row], start, way, block, step, t, leave)
            t = leave
            if to_edge[0] <= to_edge[1] and to_edge[0] <= to_edge[2]:
                axis = 0
            else:
                axis = 1 if to_edge[1] <= to_edge[2] else 2
            block[axis] += step[axis]
            to_edge[axis] += width[axis]


@inner
def _ray(eye, point, turn, shift, start, way):
    """Set start and way of a ray to its point, in cells of the world; return its length."""
    length = 0.0
    for axis in range(3):
        start[axis] = last = shift[axis]
        for m in range(3):
            start[axis] += turn[axis, m] * eye[m]
            last += turn[axis, m] * point[m]
        way[axis] = last - start[axis]
        length += way[axis] * way[axis]
    return math.sqrt(length)


@inner
def _enter_first_block(start, way, block, step, to_edge, width):
    """Set the block in which a ray starts, and how far along the ray the edges of blocks are."""
    for axis in range(3):
        block[axis] = math.floor(start[axis] / BLOCK)
        step[axis] = 1 if way[axis] > 0.0 else -1
        edge = (block[axis] + (1 if way[axis] > 0.0 else 0)) * BLOCK
        to_edge[axis] = (edge - start[axis]) / way[axis] if way[axis] != 0.0 else np.inf
        width[axis] = abs(BLOCK / way[axis]) if way[axis] != 0.0 else np.inf


@inner
def _pass_block(cells, start, way, block, step, enter, leave):
    """Count a ray in the cells of a block that it passes, by how far along the ray it does."""
    x, y, z = start[0] - block[0] * BLOCK, start[1] - block[1] * BLOCK, start[2] - block[2] * BLOCK
    i = min(max(math.floor(x + enter * way[0]), 0), BLOCK - 1)
    j = min(max(math.floor(y + enter * way[1]), 0), BLOCK - 1)
    k = min(max(math.floor(z + enter * way[2]), 0), BLOCK - 1)
    ti = (i + (step[0] > 0) - x) / way[0] if way[0] != 0.0 else np.inf
    tj = (j + (step[1] > 0) - y) / way[1] if way[1] != 0.0 else np.inf
    tk = (k + (step[2] > 0) - z) / way[2] if way[2] != 0.0 else np.inf
    wi, wj, wk = abs(1.0 / way[0]), abs(1.0 / way[1]), abs(1.0 / way[2])
    while True:
        cell = cells[(i * BLOCK + j) * BLOCK + k]
        if _through_middle(cell, x - i, y - j, z - k, way):
            _count(cell, _PASSES)
        if min(ti, tj, tk) >= leave:
            return
        if ti <= tj and ti <= tk:
            i, ti = i + step[0], ti + wi
        elif tj <= tk:
            j, tj = j + step[1], tj + wj
        else:
            k, tk = k + step[2], tk + wk
        if min(i, j, k) < 0 or max(i, j, k) >= BLOCK:
            return


@inner
def _extent(cell, axis):
    """Estimate the ends of what is in a cell along an axis, as shares of its edge.

    Few points do not reach to its ends: of n at random a share (n - 1) / (n + 1) is between them.
    """
    hits = float(cell[_HITS])
    if hits < 2.0:
        return 0.0, 1.0
    low, high = float(cell[axis] & 255) / 256.0, float((cell[axis] >> 8) + 1) / 256.0
    centre, half = 0.5 * (low + high), max(0.5 * (high - low) * (hits + 1.0) / (hits - 1.0), 0.05)
    return max(centre - half, 0.0), min(centre + half, 1.0)


@inner
def _through_middle(cell, x, y, z, way):
    """Test whether a ray passes what is in a cell at half of its size, a quarter of its section."""
    near, far = -np.inf, np.inf
    for axis, start, slope in ((_X, x, way[0]), (_Y, y, way[1]), (_Z, z, way[2])):
        low, high = _extent(cell, axis)
        low, high = 0.75 * low + 0.25 * high - start, 0.25 * low + 0.75 * high - start
        if slope == 0.0:
            if low > 0.0 or high < 0.0:
                return False
            continue
        near, far = (
            max(near, min(low / slope, high / slope)),
            min(far, max(low / slope, high / slope)),
        )
    return near <= far


@njit(cache=True, nogil=True)
def static_cells(cells, rows, block_keys, least):
    """Select what stands still in blocks, hit by at least `least` frames.

    Returns keys, cells as in `StaticWorld`, and points."""
    number = 0
    for row in rows:
        for n in range(BLOCK**3):
            number += cells[row, n, _FRAMES] >= least
    keys, points = np.empty((2, number), np.int64)
    static, size = np.empty((number, 8), np.uint8), 0
    for b in range(len(rows)):
        for n in range(BLOCK**3):
            cell = cells[rows[b], n]
            if cell[_FRAMES] < least:
                continue
            passes = 4.0 * _EVERY * float(cell[_PASSES])  # a quarter is through the middle
            share = float(cell[_HITS]) / (float(cell[_HITS]) + passes)
            if share < LEAST_SHARE:
                continue
            keys[size], points[size] = block_keys[b] * BLOCK**3 + n, cell[_HITS]
            for axis in range(3):
                low, high = _extent(cell, _X + axis)
                static[size, axis] = math.floor(255.0 * low)
                static[size, axis + 3] = math.ceil(255.0 * high)
            static[size, 6] = round(255.0 * share)
            static[size, 7] = cell[_LIGHT] // 256
            size += 1
    return keys[:size], static[:size], points[:size]

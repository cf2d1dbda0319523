"""The ground of a static world: the lowest cells of columns, where it grows from under the path.

1. `lowest_cells` is what a column starts with: ground, a roof, a branch, the upper part of a wall.
2. `grow_ground` starts under the vehicle's path, spreads to columns that start about as high, and
   fills gaps.
3. `out_of_ground` selects the cells that stand out of it, `corner_heights` samples it for a world.
"""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.logs.world import (
    BLOCK,
    CELL_M,
    HALF_LEVELS,
    HALF_TILES,
    PATCHES,
    TILE,
    cell_keys,
    cells_of_keys,
)

CLEAR_M = 0.35  # lower above the ground nothing stands: it is ground
_STEEPEST, _KERB_M = 0.08, 0.08  # of the ground, from column to column
_AROUND = 3  # columns among which ground is compared, and over which gaps are filled
_EDGE_M = BLOCK * CELL_M  # of a column

Ground = dict[tuple[int, int], NDArray[np.float64]]
"""Heights in the columns of tiles, by i and j, metres above the origin, shape (16, 16) each."""


def tile_key(i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the keys of tiles, which ascend by i, then by j; shape of both."""
    return (i + HALF_TILES) * 2 * HALF_TILES + j + HALF_TILES


def tiles_of_blocks(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return tiles i and j of keys of blocks."""
    tile = keys // (TILE**2 * 2 * HALF_LEVELS)
    return tile // (2 * HALF_TILES) - HALF_TILES, tile % (2 * HALF_TILES) - HALF_TILES


def lowest_cells(
    keys: NDArray[np.int64], cells: NDArray[np.uint8], columns: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the height above the origin of the lowest cells of columns, in the median, metres.

    NaN where there is none. `keys` and `columns` ascend; a column is a key without block and cell.
    """
    place = cells_of_keys(keys)
    fine, first = np.unique(place[:, :2], axis=0, return_inverse=True)
    height = CELL_M * (place[:, 2] + (cells[:, 2] + 0.0 + cells[:, 5]) / 510.0)
    lowest = np.full(len(fine), np.inf)
    np.minimum.at(lowest, first.ravel(), height)
    fine_keys = cell_keys(np.c_[fine, np.full(len(fine), -HALF_LEVELS * BLOCK)])
    medians = pd.Series(lowest).groupby(fine_keys // (2 * HALF_LEVELS * BLOCK**3)).median()
    return medians.reindex(columns).to_numpy(np.float64, copy=True)


@njit(cache=True, nogil=True)
def grow_ground(keys, lowest, path):
    """Grow the ground from under the vehicle's path to columns that start about as high.

    `keys` are of tiles, ascending, `lowest` their columns, shape (tiles, 16, 16); so are the
    heights returned, NaN where ground is unknown. `path` has places from the origin, metres."""
    low, heights = lowest.reshape(-1), np.full(lowest.size, np.nan)
    queue = np.empty((lowest.size, 2), np.int64)
    queued = _start_under_path(keys, path, heights, queue)
    _spread(keys, low, heights, queue, queued)
    for _ in range(_AROUND):
        _fill_gaps(keys, heights)
    return heights.reshape(lowest.shape)


@inner
def _start_under_path(keys, path, heights, queue):
    """Set the ground under the path, and queue its columns; return how many there are."""
    queued = 0
    for n in range(len(path)):
        i, j = math.floor(path[n, 0] / _EDGE_M), math.floor(path[n, 1] / _EDGE_M)
        at = _column_at(keys, i, j)
        if at >= 0:
            if math.isnan(heights[at]):
                queue[queued, 0], queue[queued, 1] = i, j
                queued += 1
            heights[at] = path[n, 2]
    return queued


@inner
def _spread(keys, low, heights, queue, queued):
    """Spread the ground from the columns in the queue, breadth first."""
    head = 0
    while head < queued:
        i, j = queue[head]
        head += 1
        for p in range(i - _AROUND, i + _AROUND + 1):
            for q in range(j - _AROUND, j + _AROUND + 1):
                at = _column_at(keys, p, q)
                if at < 0 or math.isnan(low[at]) or not math.isnan(heights[at]):
                    continue
                if _is_level(keys, heights, low[at], p, q):
                    heights[at] = low[at]
                    queue[queued, 0], queue[queued, 1] = p, q
                    queued += 1


@inner
def _is_level(keys, heights, low, i, j):
    """Test whether a column that starts at `low` is as high as most of the ground around."""
    balance = 0
    for a in range(-_AROUND, _AROUND + 1):
        for b in range(-_AROUND, _AROUND + 1):
            other = _column_at(keys, i + a, j + b)
            if other >= 0 and not math.isnan(heights[other]):
                rise = _STEEPEST * _EDGE_M * math.hypot(a, b) + _KERB_M
                balance += 1 if abs(low - heights[other]) <= rise else -1
    return balance > 0


@inner
def _fill_gaps(keys, heights):
    """Set unknown columns next to known ones to the mean of these."""
    before = heights.copy()
    for at in range(len(heights)):
        if not math.isnan(before[at]):
            continue
        key, rest = keys[at // TILE**2], at % TILE**2
        i = (key // (2 * HALF_TILES) - HALF_TILES) * TILE + rest // TILE
        j = (key % (2 * HALF_TILES) - HALF_TILES) * TILE + rest % TILE
        total = count = 0.0
        for a in (-1, 0, 1):
            for b in (-1, 0, 1):
                other = _column_at(keys, i + a, j + b)
                if other >= 0 and not math.isnan(before[other]):
                    total, count = total + before[other], count + 1.0
        if count > 0.0:
            heights[at] = total / count


@inner
def _column_at(keys, i, j):
    """Find a column among those of tiles, whose `keys` ascend; -1 if in none of them."""
    key = (i // TILE + HALF_TILES) * 2 * HALF_TILES + j // TILE + HALF_TILES
    at = np.searchsorted(keys, key)
    if at == len(keys) or keys[at] != key:
        return -1
    return at * TILE**2 + i % TILE * TILE + j % TILE


def out_of_ground(
    keys: NDArray[np.int64], cells: NDArray[np.uint8], ground: Ground
) -> NDArray[np.bool_]:
    """Return a mask of the cells that stand out of the ground, or have none under them."""
    place = cells_of_keys(keys)
    top = CELL_M * (place[:, 2] + cells[:, 5] / 255.0)
    column = place[:, :2] // BLOCK
    tiles, of_tile = np.unique(column // TILE, axis=0, return_inverse=True)
    unknown = np.full((TILE, TILE), -np.inf)
    heights = np.reshape(
        [ground.get((int(i), int(j)), unknown) for i, j in tiles], (-1, TILE, TILE)
    )
    level = heights[of_tile.ravel(), column[:, 0] % TILE, column[:, 1] % TILE]
    return np.asarray(top > np.nan_to_num(level, nan=-np.inf) + CLEAR_M)


def corner_heights(tile: tuple[int, int], ground: Ground) -> NDArray[np.float64]:
    """Return heights at the corners of the patches of a tile: means of the columns there, (9, 9).

    NaN where all of these are unknown."""
    i, j = tile
    empty, wide = np.full((TILE, TILE), np.nan), TILE // PATCHES
    near = [[ground.get((i + a, j + b), empty) for b in (-1, 0, 1)] for a in (-1, 0, 1)]
    around: NDArray[np.float64] = np.block(near)[TILE - 1 :, TILE - 1 :][: TILE + 2, : TILE + 2]
    four = [around[a::wide, b::wide][: PATCHES + 1, : PATCHES + 1] for a in (0, 1) for b in (0, 1)]
    number = np.isfinite(four).sum(axis=0)
    total = np.nansum(four, axis=0)
    return np.asarray(np.divide(total, number, out=np.full(total.shape, np.nan), where=number > 0))

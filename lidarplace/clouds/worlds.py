"""Static worlds of scenes in the tables that compiled code reads, see `static_world`."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.logs.world import (
    BLOCK,
    CELL_M,
    HALF_LEVELS,
    HALF_TILES,
    PATCHES,
    TILE,
    StaticWorld,
    cells_of_keys,
)

COLUMNS = TILE * TILE
"""Columns of a tile."""
SUNK_M = 1e-6
"""Depth of a ray under a patch where it comes in: rounding at the seam to its neighbour, metres."""
_IN_BLOCK = BLOCK**3
_LEVELS = 2 * HALF_LEVELS


class Worlds(NamedTuple):
    """Worlds of several scenes, as compiled code takes them; lengths in metres from the origins.

    Attributes:
        origins: of each scene, shape (S, 3), float64.
        grids: first tile i and j, their numbers, and where they start in `tile_of`, shape (S, 5).
        tile_of: row of each tile of the grids, -1 where there is none, int32.
        heights: of the ground of each tile, NaN where unknown, shape (T, 9, 9), float32.
        bounds: lowest and highest of what is in each column of each tile, shape (T * 256, 2).
        first_block: of each column of each tile, shape (T * 256 + 1,), int64.
        block_keys: `cell_keys` without the place in the block, shape (B,), int64.
        block_boxes: corner of the block, and the box that holds its cells, shape (B, 9), float64.
        masks: which of its cells are there, shape (B, 8), uint64.
        first_cell: before each word of its mask, shape (B, 8), int64.
        cells: as of `StaticWorld`, shape (n, 8), uint8."""

    origins: NDArray[np.float64]
    grids: NDArray[np.int64]
    tile_of: NDArray[np.int32]
    heights: NDArray[np.float32]
    bounds: NDArray[np.float64]
    first_block: NDArray[np.int64]
    block_keys: NDArray[np.int64]
    block_boxes: NDArray[np.float64]
    masks: NDArray[np.uint64]
    first_cell: NDArray[np.int64]
    cells: NDArray[np.uint8]


class WorldAround(NamedTuple):
    """The world in one frame.

    Attributes:
        worlds, scene: those of all scenes, and which of them.
        turn, shift: from the ego frame to metres from the origin of the scene, (3, 3) and (3,)."""

    worlds: Worlds
    scene: int
    turn: NDArray[np.float64]
    shift: NDArray[np.float64]


def worlds_of(worlds: Mapping[str, StaticWorld]) -> Worlds:
    """Join the worlds of scenes, in their order."""
    grids, tiles_of, heights, tile_keys, blocks = [], [], [], [], []
    number = start = 0
    for world in worlds.values():
        block_keys = world.keys // _IN_BLOCK
        of_cells = np.unique(world.keys // (_IN_BLOCK * _LEVELS * COLUMNS))
        i, j = world.tiles.astype(np.int64).T + HALF_TILES
        of_ground = i * 2 * HALF_TILES + j
        tiles = np.union1d(of_cells, of_ground)
        i, j = tiles // (2 * HALF_TILES) - HALF_TILES, tiles % (2 * HALF_TILES) - HALF_TILES
        low = [int(a.min(initial=0 if not len(a) else a[0])) for a in (i, j)]
        ni, nj = (int(a.max(initial=b)) - b + 1 for a, b in zip((i, j), low, strict=True))
        grids.append((*low, ni, nj, start))
        start += ni * nj
        grid = np.full((ni, nj), -1, np.int32)
        grid[i - low[0], j - low[1]] = number + np.arange(len(tiles))
        tiles_of.append(grid.ravel())
        ground = np.full((len(tiles), PATCHES + 1, PATCHES + 1), np.nan, np.float32)
        ground[np.searchsorted(tiles, of_ground)] = world.heights
        heights.append(ground)
        # Columns are numbered through all tiles of all scenes.
        tile, rest = np.divmod(block_keys // _LEVELS, COLUMNS)
        blocks.append((number + np.searchsorted(tiles, tile)) * COLUMNS + rest)
        tile_keys.append(block_keys)
        number += len(tiles)
    columns = np.concatenate([np.empty(0, np.int64), *blocks])
    keys = np.concatenate([np.empty(0, np.int64), *tile_keys])
    cells = np.concatenate([np.empty((0, 8), np.uint8), *(w.cells for w in worlds.values())])
    places = [cells_of_keys(world.keys) for world in worlds.values()]
    place = np.concatenate([np.empty((0, 3), np.int64), *places])
    new = np.ones(len(keys), bool)
    new[1:] = (np.diff(columns) != 0) | (np.diff(keys) != 0)
    first = np.flatnonzero(new)
    masks, first_cell, boxes = _blocks(place, cells, np.append(first, len(keys)))
    ground = np.concatenate([np.empty((0, PATCHES + 1, PATCHES + 1), np.float32), *heights])
    return Worlds(
        origins=np.array([world.origin for world in worlds.values()]).reshape(-1, 3),
        grids=np.array(grids, np.int64).reshape(-1, 5),
        tile_of=np.concatenate([np.empty(0, np.int32), *tiles_of]),
        heights=ground,
        bounds=_bounds(ground, columns[first], boxes),
        first_block=np.searchsorted(columns[first], np.arange(number * COLUMNS + 1)),
        block_keys=keys[first],
        block_boxes=boxes,
        masks=masks,
        first_cell=first_cell,
        cells=cells,
    )


def _bounds(
    ground: NDArray[np.float32], columns: NDArray[np.int64], boxes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return `bounds` of `Worlds`; `columns` and `boxes` are of its blocks."""
    ends = [slice(0, PATCHES), slice(1, PATCHES + 1)]
    patches = np.array([ground[:, a, b] for a in ends for b in ends], np.float64)
    corners = np.kron(patches, np.ones((2, 2))).reshape(4, -1)  # of the columns of each patch
    bounds = np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)
    bounds[np.isnan(bounds[:, 0])] = np.inf, -np.inf
    np.minimum.at(bounds[:, 0], columns, boxes[:, 5])
    np.maximum.at(bounds[:, 1], columns, boxes[:, 8])
    return bounds + 2 * SUNK_M * np.array([-1.0, 1.0])


@njit(cache=True, nogil=True)
def _blocks(place, cells, edges):
    """Return masks, first cells and boxes of blocks: cells from one of `edges` to the next."""
    number = len(edges) - 1
    masks, first_cell = np.zeros((number, BLOCK), np.uint64), np.zeros((number, BLOCK), np.int64)
    boxes = np.empty((number, 9))
    for b in range(number):
        boxes[b, 3:6], boxes[b, 6:] = np.inf, -np.inf
        for axis in range(3):
            boxes[b, axis] = (place[edges[b], axis] // BLOCK) * BLOCK * CELL_M
        for n in range(edges[b], edges[b + 1]):
            word, bit = place[n, 0] % BLOCK, place[n, 1] % BLOCK * BLOCK + place[n, 2] % BLOCK
            masks[b, word] |= np.uint64(1) << np.uint64(bit)
            for axis in range(3):
                low, high = cells[n, axis] / 255.0, cells[n, axis + 3] / 255.0
                boxes[b, axis + 3] = min(boxes[b, axis + 3], (place[n, axis] + low) * CELL_M)
                boxes[b, axis + 6] = max(boxes[b, axis + 6], (place[n, axis] + high) * CELL_M)
        count = edges[b]
        for word in range(BLOCK):
            first_cell[b, word] = count
            count += bit_count(masks[b, word])
    return masks, first_cell, boxes


@inner
def bit_count(word):
    """Return the number of bits of a word that are set."""
    word -= (word >> np.uint64(1)) & np.uint64(0x5555555555555555)
    word = (word & np.uint64(0x3333333333333333)) + (
        (word >> np.uint64(2)) & np.uint64(0x3333333333333333)
    )
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))

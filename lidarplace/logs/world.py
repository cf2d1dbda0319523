"""Static world of a scene: small boxes in cells of what is no object, and heights of the ground.

Cells are cubes of `CELL_M`; 8 cells along each axis are a block, blocks above each other a column,
and 16 by 16 columns a tile. The ground is known where there are tiles, at points `PATCH_M` apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.arrays import read_npz

CELL_M = 0.2
BLOCK = 8  # cells along an edge of a block
TILE = 16  # columns along an edge of a tile
PATCHES = 8  # patches of ground along an edge of a tile
TILE_M = CELL_M * BLOCK * TILE
PATCH_M = TILE_M / PATCHES
HALF_TILES, HALF_LEVELS = 2**12, 2**9
"""Tiles along x and y, and blocks along z, to each side of the origin."""


@dataclass(frozen=True, eq=False)
class StaticWorld:
    """The static world of a scene."""

    origin: NDArray[np.float64]
    """Corner of cell (0, 0, 0) in the world frame of the scene, metres, shape (3,)."""
    keys: NDArray[np.int64]  # of the cells, see `cell_keys`; ascending, shape (n,)
    cells: NDArray[np.uint8]
    """x0, y0, z0, x1, y1, z1 of what is in each cell, in 1/255 of its edge; the share of the rays
    at it that it stops; and its reflectivity, as a recorded intensity; both in 1/255; (n, 8)."""
    tiles: NDArray[np.int32]
    """i, j of tiles with ground, which start at (i, j) * `TILE_M` from the origin, shape (t, 2)."""
    heights: NDArray[np.float32]
    """Heights of ground at the corners of their patches, metres above the origin, [x, y], shape
    (t, 9, 9); NaN where it is unknown: a patch needs its four."""

    def boxes(self) -> NDArray[np.float64]:
        """Return boxes of the cells: x0, y0, z0, x1, y1, z1 in the world, metres, shape (n, 6)."""
        corner = np.tile(cells_of_keys(self.keys), 2)
        return np.tile(self.origin, 2) + CELL_M * (corner + self.cells[:, :6] / 255.0)


def cell_keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number cells (i, j, k), shape (n, 3) to (n,): by tile, column, block and place."""
    i, j, k = cells.T
    tile = (i // (TILE * BLOCK) + HALF_TILES) * 2 * HALF_TILES + j // (TILE * BLOCK) + HALF_TILES
    column = i // BLOCK % TILE * TILE + j // BLOCK % TILE
    block = (tile * TILE**2 + column) * 2 * HALF_LEVELS + k // BLOCK + HALF_LEVELS
    return np.asarray(((block * BLOCK + i % BLOCK) * BLOCK + j % BLOCK) * BLOCK + k % BLOCK)


def cells_of_keys(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the cells of `cell_keys`, shape (n,) to (n, 3)."""
    rest, k = np.divmod(keys, BLOCK)
    rest, j = np.divmod(rest, BLOCK)
    rest, i = np.divmod(rest, BLOCK)
    rest, level = np.divmod(rest, 2 * HALF_LEVELS)
    rest, column = np.divmod(rest, TILE**2)
    ti, tj = np.divmod(rest, 2 * HALF_TILES)
    ti, tj = (ti - HALF_TILES) * TILE + column // TILE, (tj - HALF_TILES) * TILE + column % TILE
    return np.stack(
        [ti * BLOCK + i, tj * BLOCK + j, (level - HALF_LEVELS) * BLOCK + k], axis=1
    ).astype(np.int64)


_ARRAYS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "origin": (np.float64, (3,)),
    "keys": (np.int64, (-1,)),
    "cells": (np.uint8, (-1, 8)),
    "tiles": (np.int32, (-1, 2)),
    "heights": (np.float32, (-1, PATCHES + 1, PATCHES + 1)),
}
"""Type and shape of every attribute; -1 for any length."""


def write_worlds(path: Path, worlds: Mapping[str, StaticWorld]) -> None:
    """Write the worlds of scenes to a `.npz` file."""
    arrays = {
        f"{number}/{name}": getattr(world, name)
        for number, world in enumerate(worlds.values())
        for name in _ARRAYS
    }
    with path.open("wb") as file:
        np.savez_compressed(file, scenes=np.array(list(worlds), dtype=str), **arrays)


def read_worlds(path: Path) -> dict[str, StaticWorld]:
    """Read what `write_worlds` wrote, by the names of the scenes.

    Raises OSError for a file that cannot be read, ValueError for another or a damaged one."""
    arrays, worlds = read_npz(path), {}
    scenes = arrays.get("scenes", np.empty(0, str))
    if "scenes" not in arrays or scenes.dtype.kind != "U" or scenes.ndim != 1:
        raise InputError("not a static world of a log", place=path)
    for number, scene in enumerate(scenes.tolist()):
        place = f"{path}: scene {scene}"
        for name, (dtype, shape) in _ARRAYS.items():
            array = arrays.get(f"{number}/{name}")
            lengths = () if array is None or array.dtype != dtype else array.shape
            if len(lengths) != len(shape) or any(
                want not in (-1, have) for have, want in zip(lengths, shape, strict=True)
            ):
                raise InputError("missing, or of another shape", place=place, key=name)
        world = StaticWorld(**{name: arrays[f"{number}/{name}"] for name in _ARRAYS})
        if not (
            len(world.keys) == len(world.cells)
            and len(world.tiles) == len(world.heights)
            and bool((np.diff(world.keys) > 0).all())
            and np.isfinite(world.origin).all()
            and not np.isinf(world.heights).any()
        ):
            raise InputError("arrays that do not fit together", place=place)
        worlds[scene] = world
    return worlds

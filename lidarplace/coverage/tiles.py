"""Tiles of columns, and the layers of each between which a scene has anything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.coverage.cone_columns import TILE_X, TILE_Y


@dataclass(frozen=True, eq=False)
class Tiles:
    """Layers that matter in every tile of TILE_X × TILE_Y columns of a grid.

    First and last have shape (tiles in x, tiles in y), int32; nothing matters in a tile where
    `highest < lowest`."""

    lowest: NDArray[np.int32]
    highest: NDArray[np.int32]

    @classmethod
    def whole(cls, shape: tuple[int, int, int]) -> Tiles:
        """Return tiles of which all voxels of a grid matter."""
        tiles = (-(-shape[0] // TILE_X), -(-shape[1] // TILE_Y))
        return cls(np.zeros(tiles, np.int32), np.full(tiles, shape[2] - 1, np.int32))

    @classmethod
    def of_voxels(cls, matters: NDArray[np.bool_]) -> Tiles:
        """Return the tiles of the voxels of the mask `matters`, shape (nx, ny, nz)."""
        nx, ny, nz = matters.shape
        lines = np.logical_or.reduceat(matters, np.arange(0, nx, TILE_X), axis=0)
        layers = np.logical_or.reduceat(lines, np.arange(0, ny, TILE_Y), axis=1)
        some = layers.any(axis=2)
        lowest = np.where(some, layers.argmax(axis=2), nz)
        highest = np.where(some, nz - 1 - layers[..., ::-1].argmax(axis=2), -1)
        return cls(lowest.astype(np.int32), highest.astype(np.int32))

    def __or__(self, other: Tiles) -> Tiles:
        """Return the layers that matter to one or the other."""
        return Tiles(np.minimum(self.lowest, other.lowest), np.maximum(self.highest, other.highest))

    def along(self, axis: int, shape: tuple[int, int, int]) -> Tiles:
        """Return tiles of the grid whose columns run along `axis`; `shape` is that of the grid.

        The axes of that grid are (y, z, x) for axis 0 and (x, z, y) for axis 1. Each of its tiles
        spans whole tiles of this one, so it may hold more than matters, never less."""
        if axis == 2:
            return self
        run, side = (TILE_X, TILE_Y) if axis == 0 else (TILE_Y, TILE_X)
        lowest, highest = (layer.T if axis == 0 else layer for layer in (self.lowest, self.highest))
        # Now (tiles aside, tiles along the run). Layers become columns of the new grid.
        layers = (np.arange(-(-shape[2] // TILE_Y)) * TILE_Y)[:, None]
        meets = (lowest[:, None] <= layers + TILE_Y - 1) & (highest[:, None] >= layers)
        some = meets.any(axis=2)
        first = np.where(some, meets.argmax(axis=2) * run, shape[axis])
        last = np.where(some, (meets.shape[2] - meets[..., ::-1].argmax(axis=2)) * run - 1, -1)
        last = np.minimum(last, shape[axis] - 1)
        rows = np.arange(0, shape[1 - axis], TILE_X) // side
        return Tiles(first[rows].astype(np.int32), last[rows].astype(np.int32))

"""Tracing of single candidates through occupied voxels: coverage, rays, chances to be missed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.base.roi import Roi
from lidarplace.coverage import covered_bits, rays_of
from lidarplace.coverage.rays import ray_counts, ray_weight
from lidarplace.coverage.tiles import Tiles
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.selection.voxel_gain import SATURATED, Shape
from lidarplace.pog.surrogates.evaluate import (
    common_roi,
    log_miss_in,
    occupied_layers,
    occupied_tiles,
)
from lidarplace.pog.surrogates.formulas import log_miss_of_ray
from lidarplace.pog.surrogates.inputs import Sensing
from lidarplace.rigs.placement import Placement

Objective = Literal["covered_entropy", "expected_ig", "expected_points"]
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)
"""Surrogates that are monotone and submodular in the set of LiDARs."""


@dataclass(frozen=True, eq=False)
class Block:
    """Occupied voxels of a grid by layers, as rays are counted, so that memory is read in order.

    Their `places` are `k * nx * ny + i * ny + j`, `counts` the frames in which each class of the
    block occupies them, else 0, shape (classes, voxels), `first` the number of the first voxel."""

    places: NDArray[np.int64]
    counts: NDArray[np.int32]
    first: int


class Tracing:
    """Exposures of single candidates."""

    def __init__(
        self, grids: Mapping[str, OccupancyGrid], surrogate: Objective, sensing: Sensing
    ) -> None:
        method, q, occlusion = sensing.method, sensing.detection_probability, sensing.occlusion
        self.grids, self.method, self.azimuth_stride = grids, method, sensing.azimuth_stride
        self.roi = common_roi(grids)
        self.tiles: Tiles = occupied_tiles(grids)
        self.occupied: Roi = occupied_layers(self.roi, self.tiles, rays_of(method))
        self.q = q
        self.occlusion = occlusion and surrogate == "expected_ig"
        self.covers = surrogate == "covered_entropy"
        self.certain = surrogate == "expected_ig" and q == 1 and not occlusion
        self.informs = surrogate == "expected_ig" and not self.certain
        names = [[name] for name in grids] if self.occlusion else [list(grids)]
        self.blocks: list[Block] = []
        for classes in names:
            first = sum(len(block.places) for block in self.blocks)
            self.blocks.append(self._block(classes, first))

    @property
    def shape(self) -> Shape:
        """Shape of the gain of a voxel; if every ray detects, one is as good as many."""
        if self.covers or self.certain:
            return "cover"
        return "information" if self.informs else "linear"

    def _block(self, classes: Sequence[str], first: int) -> Block:
        layers = self.occupied.shape[2]
        occupied = np.logical_or.reduce(
            [self.grids[name].counts[..., :layers] > 0 for name in classes]
        )
        places = np.flatnonzero(np.ascontiguousarray(occupied.transpose(2, 0, 1)))
        k, i, j = np.unravel_index(places, (layers, *self.roi.shape[:2]))
        counts = np.zeros((len(self.grids), len(places)), np.int32)
        for c, (name, grid) in enumerate(self.grids.items()):
            if name in classes:
                counts[c] = grid.counts[i, j, k]
        return Block(places, counts, first)

    def scale(self, candidate: Placement) -> float:
        """Return the exposure that an amount of `of_candidate` counts."""
        if self.shape == "cover" or self.occlusion:
            return 1.0
        weight = ray_weight(candidate, self.azimuth_stride)
        return -weight * log_miss_of_ray(self.q) if self.informs else weight

    def of_candidate(self, candidate: Placement) -> tuple[NDArray[np.uint32], NDArray[Any]]:
        """Return voxels and amounts of one candidate."""
        if self.covers:
            bits = covered_bits(candidate, self.roi, self.method, self.tiles)
            voxels = _covered(bits.reshape(len(bits), -1), self.blocks[0].places)
            return voxels, np.broadcast_to(np.float32(1), len(voxels))
        method = rays_of(self.method)
        if not self.occlusion:
            rays = ray_counts(candidate, self.occupied, method, self.azimuth_stride)
            voxels, amounts = _exposed(_in_layers(rays), self.blocks[0].places)
            # Integers below 2^24 are exact in float32.
            exact = np.float32 if amounts.max(initial=0) < 2**24 else np.float64
            return voxels, np.minimum(amounts, 1 if self.certain else np.inf).astype(exact)
        parts = []
        for block, grid in zip(self.blocks, self.grids.values(), strict=True):
            settings = candidate, self.occupied, method, self.q, self.azimuth_stride
            voxels, amounts = _exposed(_in_layers(-log_miss_in(grid, *settings)), block.places)
            parts.append((voxels + np.uint32(block.first), np.minimum(amounts, SATURATED)))
        return np.concatenate([v for v, _ in parts]), np.concatenate([a for _, a in parts])


def _in_layers(by_voxel: NDArray[Any]) -> NDArray[Any]:
    """Return (nx, ny, layers) in the order of `Block.places`; rays are counted in it, no copy."""
    return by_voxel.transpose(2, 0, 1).reshape(-1)


@njit(cache=True, nogil=True)
def _covered(bits, places):
    """Return numbers of the places that are covered; bits of shape (words, nx * ny)."""
    voxels = np.empty(len(places) + 1, np.uint32)
    columns = bits.shape[1]
    size, layer = np.int64(0), 0
    for v in range(len(places)):
        while places[v] >= (layer + 1) * columns:
            layer += 1
        word = bits[layer >> 6, places[v] - layer * columns]
        voxels[size] = v
        size += np.int64((word >> np.uint64(layer & 63)) & np.uint64(1))
    return voxels[:size].copy()


@njit(cache=True, nogil=True)
def _exposed(amount, places):
    """Return numbers and amounts of the places whose amount is positive."""
    voxels, amounts = np.empty(len(places) + 1, np.uint32), np.empty(len(places) + 1, amount.dtype)
    size = 0
    for v in range(len(places)):
        voxels[size], amounts[size] = v, amount[places[v]]
        size += int(amount[places[v]] > 0)
    return voxels[:size].copy(), amounts[:size].copy()

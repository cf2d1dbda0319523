"""The formulas of the surrogates that need rays (docs/method.md). Entropies are in nats."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.pog.occupancy.grid import OccupancyGrid

_TABLE = 2**20  # entries: 8 MB


@dataclass(frozen=True, eq=False)
class Crossings:
    """Number of voxels by frames in which they are occupied and rays that cross them.

    Attributes:
        counts, rays: the different pairs, which are few, int64, shape (pairs,).
        voxels: number of voxels of each pair, int64, shape (pairs,)."""

    counts: NDArray[np.int64]
    rays: NDArray[np.int64]
    voxels: NDArray[np.int64]

    @classmethod
    def of_grid(cls, grid: OccupancyGrid, rays: NDArray[np.integer]) -> Crossings:
        """Count pairs for `rays` through the voxels of the grid, shape (nx, ny, layers).

        Layers above the highest occupied voxel may be missing; ValueError for another shape."""
        levels = grid.levels
        highest = int(levels.tiles.highest.max())
        if rays.shape[:2] != grid.roi.shape[:2] or rays.shape[2] <= highest:
            raise ValueError(
                f"rays of shape {rays.shape} do not fit a grid of shape {grid.roi.shape} that is "
                f"occupied up to layer {highest}"
            )
        occupied = int(levels.total.sum())
        level, rays_of_voxel = np.empty(occupied + 1, np.int32), np.empty(occupied + 1, np.int32)
        sets = levels.first, levels.voxels, levels.level
        crossed = _list_crossed(rays, *sets, level, rays_of_voxel)
        level, rays_of_voxel = level[:crossed], rays_of_voxel[:crossed]
        base = int(rays_of_voxel.max(initial=0)) + 1
        pair_of_voxel = level * np.int64(base) + rays_of_voxel
        if len(levels.counts) * base <= max(_TABLE, occupied):
            table = np.bincount(pair_of_voxel)  # no sorting
            pairs = np.flatnonzero(table)
            voxels = table[pairs]
        else:
            pairs, voxels = np.unique(pair_of_voxel, return_counts=True)
        level_of_pair, rays_of_pair = np.divmod(pairs, base)
        return cls(levels.counts[level_of_pair].astype(np.int64), rays_of_pair, voxels)


@njit(cache=True, nogil=True)
def _list_crossed(rays, first, voxels, level, level_of_voxel, rays_of_voxel):
    """List the occupied voxels that rays cross, and return their number; room for one more."""
    nx, ny, _ = rays.shape
    size, one = np.int64(0), np.uint64(1)
    for column in range(len(first) - 1):
        i, j = column // ny % nx, column % ny
        for n in range(first[column], first[column + 1]):
            left, k = voxels[n], column // (nx * ny) * 64
            while left:
                m = rays[i, j, k]
                level_of_voxel[size], rays_of_voxel[size] = level[n], m
                size += np.int64(left & one) & np.int64(m > 0)  # no branch, which none could guess
                left >>= one
                k += 1
    return size


def expected_points(frames: int, crossings: Crossings, ray_weight: float) -> float:
    """Return `sum of m(v) p(v)`: rays that meet an object in a frame, if nothing hid it.

    `ray_weight` rays stand behind each one traced. Products of integers are summed without
    error."""
    meetings = math.fsum(crossings.counts * crossings.rays * crossings.voxels.astype(np.float64))
    return meetings * ray_weight / frames


def log_miss_of_ray(q: float) -> float:
    """Return `ln(1 - q)`, for a ray that detects what it crosses with probability q.

    It is -inf for q = 1."""
    return math.log1p(-q) if q < 1 else -math.inf


def expected_ig(frames: int, crossings: Crossings, log_miss: float) -> float:
    """Return the mutual information, in nats, between occupancy and a sensor that can miss.

    With `d = 1 - (1 - q)^m` the probability that an object in v is detected, no false alarms: `I(v)
    = H(p) - (1 - p d) h(p (1 - d) / (1 - p d))`, h the binary entropy; the sum over v. `log_miss`:
    `log_miss_of_ray(q)`, times the rays that stand behind each one traced."""
    p, rest = crossings.counts / frames, (frames - crossings.counts) / frames
    gain = information(p, rest, crossings.rays * log_miss)
    return float(np.sum(crossings.voxels * gain))


def expected_ig_with_occlusion(grid: OccupancyGrid, log_miss: NDArray[np.float64]) -> float:
    """Return `expected_ig` with `1 - d = prod over rays of (1 - q w)` of every voxel.

    `log_miss`: `ln(1 - d)`, shape (nx, ny, layers), see `lidarplace.coverage.rays.log_miss`; layers
    above the highest occupied voxel may be missing."""
    counts = grid.counts[..., : log_miss.shape[2]]
    crossed = (counts > 0) & (log_miss < 0)
    counts = counts[crossed]
    p, rest = counts / grid.frames, (grid.frames - counts) / grid.frames
    return float(np.sum(information(p, rest, log_miss[crossed])))


@njit(cache=True, nogil=True)
def information(p, rest, log_miss):
    """Return I(v) of `expected_ig` for arrays of p > 0, 1 - p and log_miss = ln(1 - d) < 0."""
    result = np.empty(len(p))
    for i in range(len(p)):
        result[i] = information_at(p[i], rest[i], log_miss[i])
    return result


@inner
def information_at(p, rest, log_miss):
    """Return I(v) without a difference of entropies, which cancels where d, p or 1 - p is small.

    With g(x) = (1 - x) ln(1 - x) + x, and 1 - p d the probability that nothing is detected:
    `I = -p d ln p + p g(d) - g(p d)` for small p, and
    `I = -p d ln p - (1 - p) ln(1 - p d) - p (1 - d) ln(1 + (1 - p) d / (1 - d))` for large p."""
    d, miss = -math.expm1(log_miss), math.exp(log_miss)
    if p < 0.5:
        return -p * d * math.log(p) + p * _g(d, miss) - _g(p * d, rest + p * miss)
    if rest == 0:
        return 0.0
    log_silent = math.log1p(-p * d) if p * d < 0.5 else math.log(rest + p * miss)
    gain = -p * d * math.log1p(-rest) - rest * log_silent
    if miss > 1e-19 * rest:  # else the term is below the last bit, and the quotient may overflow
        gain -= p * miss * math.log1p(rest * d / miss)
    return gain


@inner
def _g(x, left):
    """Return (1 - x) ln(1 - x) + x for left = 1 - x."""
    if x < 1e-3:  # series: x^2/2 + x^3/6 + x^4/12 + ..., next term below 1e-16 relative
        series = 1 / 2 + x * (1 / 6 + x * (1 / 12 + x * (1 / 20 + x * (1 / 30 + x / 42))))
        return x * x * series
    return left * math.log1p(-x) + x if x < 1 else 1.0

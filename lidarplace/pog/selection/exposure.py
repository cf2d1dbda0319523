"""Exposure of every occupied voxel to every candidate: the matrix of greedy choice and bound."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.selection.submodular import check_weights
from lidarplace.pog.selection.tracing import Objective, Tracing
from lidarplace.pog.selection.voxel_gain import SATURATED, VoxelGain, gain_at
from lidarplace.pog.surrogates.inputs import Sensing
from lidarplace.rigs.placement import Placement

_ENOUGH = 45.0  # nats: a chance of exp(-45) to be missed moves no float64
_LADDER = 2**22  # entries: 32 MB


@dataclass(frozen=True, eq=False)
class Exposure:
    """Exposures of voxels to candidates, by rows.

    Candidate e has the entries `offsets[e]` to `offsets[e + 1]`. Exposures add up over the
    candidates of a set.

    Voxels that no class occupies are left out. With occlusion what a ray gives depends on the
    class, so a voxel stands there once for each class.

    `voxels` are ascending within a candidate, `amounts` their exposures, positive: 1 for a covered
    voxel, rays traced, or `-ln(1 - d)` with occlusion, shape (entries,). `scale`, (candidates,), is
    what one of its amounts counts in `gain`, what a voxel is worth by the sum of its exposures."""

    offsets: NDArray[np.int64]
    voxels: NDArray[np.uint32]
    amounts: NDArray[np.float32] | NDArray[np.float64]
    scale: NDArray[np.float64]
    gain: VoxelGain

    @classmethod
    def of_candidates(
        cls,
        grids: Mapping[str, OccupancyGrid],
        weights: Mapping[str, float],
        candidates: Sequence[Placement],
        surrogate: Objective = "expected_ig",
        sensing: Sensing = Sensing(),
    ) -> Exposure:
        """Trace every candidate once, in as many threads as numba has.

        `grids` are a POG for each class, of one ROI. The value of a set is the sum over the classes
        by `weights` (unless 0) of the surrogate of its union, if the LiDARs of all candidates have
        the same `ray_weight`; else `evaluate_classes` takes the mean over the LiDARs of a rig.
        Raises ValueError: a weight that is negative or of an unknown class, grids of different
        ROIs, or a stride below 1."""
        check_weights(weights, [*grids])
        weighted = {name: grid for name, grid in grids.items() if weights.get(name, 0) > 0}
        weighted = weighted or dict(grids)
        source = Tracing(weighted, surrogate, sensing)
        with ThreadPoolExecutor(numba.get_num_threads()) as threads:
            parts = list(threads.map(source.of_candidate, candidates))
        voxels, amounts = [part[0] for part in parts], [part[1] for part in parts]
        del parts  # so that each can be given free
        offsets = np.concatenate([[0], np.cumsum([len(part) for part in voxels], dtype=np.int64)])
        kind = np.result_type(np.float32, *(part.dtype for part in amounts))
        counts = np.concatenate([block.counts for block in source.blocks], axis=1)
        entries = _joined(voxels, np.uint32), _joined(amounts, kind)
        scale = np.array([source.scale(candidate) for candidate in candidates])
        gain = VoxelGain.of_voxels(source.shape, weighted, weights, counts)
        return cls(offsets.astype(np.int64), *entries, scale, gain)

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return len(self.scale)

    @property
    def rows(self) -> tuple[NDArray[Any], ...]:
        """Arguments of the compiled functions."""
        return self.offsets, self.voxels, self.amounts, self.scale

    def total(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the exposure of every voxel to `share` of each candidate, shape (voxels,)."""
        total = np.zeros(len(self.gain.profile))
        for candidate in np.flatnonzero(share):
            add_exposure(self.rows, candidate, share[candidate], total)
        return total

    def value(self, chosen: Iterable[int]) -> float:
        """Return the value of a set of candidates, in nats (`expected_points`: points a frame)."""
        share = np.zeros(self.candidates)
        share[list(chosen)] = 1.0
        return float(np.sum(gains_of(self.gain.tables, self.total(share))))

    @cached_property
    def ladder(self) -> NDArray[np.float64]:
        """Gain g at 0, 1, 2, ... rays, the last at infinitely many, shape (profiles, rungs).

        For expected_ig, whose formula takes long; empty where the rays of the candidates count
        differently, or where the table would be large."""
        profiles, one = len(self.gain.worth), self.scale[:1]
        counted = self.gain.shape == "information" and self.amounts.dtype == np.float32
        if not counted or not one.size or not (self.scale == one).all():
            return np.empty((0, 0))
        rungs = 2 + math.ceil(_ENOUGH / one[0])
        if profiles * rungs > _LADDER:
            return np.empty((0, 0))
        exposure = np.append(np.arange(rungs - 1) * one, SATURATED)
        _, first = np.unique(self.gain.profile, return_index=True)
        return _ladder_of(self.gain.tables, first, exposure)

    @cached_property
    def least(self) -> NDArray[np.float64]:
        """Least positive exposure that a candidate gives a voxel, inf if none does, (voxels,)."""
        least = np.full(len(self.gain.profile), np.inf)
        _least(self.rows, least)
        return least


def _joined(parts: list[NDArray[Any]], kind: np.dtype[Any] | type[Any]) -> NDArray[Any]:
    """Return the parts one after another, each given free once copied.

    Ones alone take no memory."""
    if parts and all(part.strides == (0,) for part in parts):
        return np.broadcast_to(np.array(1, kind), sum(len(part) for part in parts))
    joined = np.empty(sum(len(part) for part in parts), kind)
    end = len(joined)
    while parts:
        part = parts.pop()
        joined[end - len(part) : end] = part
        end -= len(part)
    return joined


@njit(cache=True, nogil=True)
def add_exposure(rows, candidate, share, total):
    """Add `share` of what a candidate gives."""
    offsets, voxels, amounts, scale = rows
    for n in range(offsets[candidate], offsets[candidate + 1]):
        total[voxels[n]] += share * scale[candidate] * amounts[n]


@njit(cache=True, nogil=True)
def gains_of(tables, total):
    """Return g_v of every voxel at its exposure."""
    gains = np.empty(len(total))
    for v in range(len(total)):
        gains[v] = gain_at(tables, v, total[v])
    return gains


@njit(cache=True, nogil=True)
def _ladder_of(tables, voxels, exposure) -> NDArray[np.float64]:
    """Return g of one voxel of every profile at some exposures, shape (profiles, exposures)."""
    ladder = np.empty((len(voxels), len(exposure)))
    for n in range(len(voxels)):
        for rung in range(len(exposure)):
            ladder[n, rung] = gain_at(tables, voxels[n], exposure[rung])
    return ladder


@njit(cache=True, nogil=True)
def _least(rows, least):
    offsets, voxels, amounts, scale = rows
    for candidate in range(len(scale)):
        for n in range(offsets[candidate], offsets[candidate + 1]):
            least[voxels[n]] = min(least[voxels[n]], scale[candidate] * amounts[n])

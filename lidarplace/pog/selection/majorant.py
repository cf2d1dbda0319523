"""Functions that are never below the value of a set, and linear in its candidates.

For every voxel take a function of the exposures m_e that candidates would add to it:

- a line above the concave g_v: `constant + slope * sum of m_e`, or
- steps from any exposure s: `g_v(s) + sum of (g_v(s + m_e) - g_v(s))`, which is at least `g_v(s +
  sum of m_e)` because g_v is concave, and so at least `g_v(sum of m_e)`.

Summed over the voxels they bound the value of every set. With s the exposure that a set has
already, the steps are what each candidate adds to it."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.pog.selection.cuts import Cut
from lidarplace.pog.selection.exposure import Exposure, gains_of
from lidarplace.pog.selection.submodular import Added, SubmodularChoice
from lidarplace.pog.selection.voxel_gain import gain_at, slope_at

_STEPS = -1.0
_PART = 1024  # terms summed up before they join the sum, whose error stays below 1e-13


@dataclass(frozen=True, eq=False)
class Majorant:
    """A line or steps for every voxel.

    Arrays are float64, shape (voxels,): `constant`, where no candidate adds anything; `slopes` of
    the lines, or -1 for steps; `start`, the exposure at which steps start, in rungs of the ladder
    if there is one."""

    exposure: Exposure
    constant: NDArray[np.float64]
    slopes: NDArray[np.float64]
    start: NDArray[np.float64]

    @classmethod
    def of_set(cls, exposure: Exposure, chosen: Sequence[int]) -> Majorant:
        """Return the majorant of what candidates add to a set.

        Its `constant` are the gains of the set."""
        share = np.zeros(exposure.candidates)
        share[list(chosen)] = 1.0
        total = exposure.total(share)
        constant, slopes = gains_of(exposure.gain.tables, total), np.full(len(total), _STEPS)
        if exposure.gain.shape == "information":
            return cls(exposure, constant, slopes, _start(exposure, total))
        # The part of g that a candidate can still reach is a line.
        _lines(exposure.gain.tables, total, np.zeros(len(total)), np.empty(len(total)), slopes)
        return cls(exposure, constant, slopes, total)

    @classmethod
    def at(cls, exposure: Exposure, share: NDArray[np.float64]) -> Majorant:
        """Return a majorant that is low where `share` of each candidate is chosen.

        `share` has shape (candidates,), in [0, 1].

        Lines touch g_v at the exposure t to all shares. As no candidate adds less than the least
        exposure, where t is smaller the line may go through 0 and g_v there, which is lower. Steps
        from 0 are lower still where single candidates nearly saturate a voxel, steps from t where a
        part of them did."""
        tables = exposure.gain.tables
        total = exposure.total(share)
        constant, slopes = np.empty(len(total)), np.empty(len(total))
        _lines(tables, total, exposure.least, constant, slopes)
        start = np.zeros(len(total))
        if exposure.gain.shape == "information":
            value, rows, ladder = constant + slopes * total, exposure.rows, exposure.ladder
            for begin in (0.0, 0.5, 1.0):
                exposed = _start(exposure, begin * total)
                gains = gains_of(tables, exposed * _unit(exposure))
                reached = gains.copy()
                for e in np.flatnonzero(share):
                    _climb(rows, (e, share[e]), tables, ladder, exposed, gains, reached)
                low = reached < value
                value[low], constant[low], start[low] = reached[low], gains[low], exposed[low]
                slopes[low] = _STEPS
        return cls(exposure, constant, slopes, start)

    def added(self, candidate: int, edges: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Return the gain of a candidate, by blocks of voxels, shape (blocks,).

        Block b is `edges[b]` to `edges[b + 1]`; None: one block of all voxels."""
        edges = np.array([0, len(self.constant)]) if edges is None else edges
        exposure, lines = self.exposure, (self.constant, self.slopes, self.start)
        tables = exposure.gain.tables, exposure.ladder
        return _added(exposure.rows, candidate, *tables, lines, edges)

    def cut(self, blocks: int) -> Cut:
        """Return the sums over blocks of voxels."""
        edges = np.linspace(0, len(self.constant), blocks + 1).astype(np.int64)
        with ThreadPoolExecutor(numba.get_num_threads()) as threads:
            parts = threads.map(lambda e: self.added(e, edges), range(self.exposure.candidates))
            slopes = np.array(list(parts)).reshape(-1, blocks).T
        return Cut(np.array([self.constant[a:b].sum() for a, b in pairwise(edges)]), slopes)


@dataclass(frozen=True, eq=False)
class VoxelChoice(SubmodularChoice):
    """Candidates by how much they expose the voxels."""

    exposure: Exposure

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return self.exposure.candidates

    def value(self, chosen: Sequence[int]) -> float:
        """Return the value of a set of candidates."""
        return self.exposure.value(chosen)

    def _added_to(self, chosen: Sequence[int]) -> Added:
        set_so_far = Majorant.of_set(self.exposure, chosen)
        return lambda candidate: float(set_so_far.added(candidate)[0])

    def _cut_of_set(self, chosen: Sequence[int], blocks: int) -> Cut:
        return Majorant.of_set(self.exposure, chosen).cut(blocks)

    def _tangent(self, share: NDArray[np.float64], blocks: int) -> Cut:
        return Majorant.at(self.exposure, share).cut(blocks)


def _unit(exposure: Exposure) -> float:
    """Return the exposure of a rung of the ladder; 1 where there is none."""
    return float(exposure.scale[0]) if exposure.ladder.size else 1.0


def _start(exposure: Exposure, total: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an exposure near `total` from which steps may start: a rung of the ladder if any."""
    return np.rint(total / _unit(exposure)) if exposure.ladder.size else total


@njit(cache=True, nogil=True)
def _lines(tables, total, least, constant, slopes):
    for v in range(len(total)):
        if total[v] < least[v]:
            constant[v] = 0.0
            slopes[v] = gain_at(tables, v, least[v]) / least[v] if least[v] < np.inf else 0.0
        else:
            slopes[v] = slope_at(tables, v, total[v])
            constant[v] = max(0.0, gain_at(tables, v, total[v]) - slopes[v] * total[v])


@njit(cache=True, nogil=True)
def _climb(rows, part, tables, ladder, start, gains, reached):
    """Add a part, a candidate and its share, of what it adds by steps to `reached`."""
    (offsets, voxels, amounts, scale), (candidate, share) = rows, part
    profile, top, scaled = tables[1], ladder.shape[1] - 1, scale[candidate]
    for n in range(offsets[candidate], offsets[candidate + 1]):
        v = voxels[n]
        if top >= 0:
            after = ladder[profile[v], min(int(start[v] + amounts[n]), top)]
        else:
            after = gain_at(tables, v, start[v] + scaled * amounts[n])
        reached[v] += share * (after - gains[v])


@njit(cache=True, nogil=True)
def _added(rows, candidate, tables, ladder, lines, edges) -> NDArray[np.float64]:
    (offsets, voxels, amounts, scale), (constant, slopes, start) = rows, lines
    profile, top, scaled = tables[1], ladder.shape[1] - 1, scale[candidate]
    added = np.zeros(len(edges) - 1)
    n, last = offsets[candidate], offsets[candidate + 1]
    for block in range(len(added)):
        edge = edges[block + 1]
        while n < last and voxels[n] < edge:
            part, stop = 0.0, min(n + _PART, last)
            while n < stop and voxels[n] < edge:
                v = voxels[n]
                if slopes[v] >= 0:
                    part += slopes[v] * scaled * amounts[n]
                elif top >= 0:
                    rung = min(int(start[v] + amounts[n]), top)
                    part += ladder[profile[v], rung] - constant[v]
                else:
                    part += gain_at(tables, v, start[v] + scaled * amounts[n]) - constant[v]
                n += 1
            added[block] += part
    return added

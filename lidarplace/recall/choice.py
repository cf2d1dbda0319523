"""Which of many candidate mounts find most: greedy choice by `expected_recall`, and its bound.

The value of a set is a weighted sum of `expected_recall` over classes. The cells that a set hits
are a union and every detection curve is concave, so it is monotone and submodular.

At shares of the candidates between 0 and 1 a cell is hit by the sum of the shares of those that
hit it, at most 1. The curve of the sum over cells is concave in the shares, and the value where
they are 0 or 1: tangents of it are cuts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.pog.selection.cuts import Cut
from lidarplace.pog.selection.greedy import Added, Greedy, lazy_greedy
from lidarplace.pog.selection.limits import Limits
from lidarplace.pog.selection.upper_bound import UpperBound, bound_by_cuts
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.recall.surface_cells import SurfaceCells, slices_of

BLOCKS = 32
"""Parts of the objects that have cuts of their own: the sum of their least cuts is lower than the
least of their sums."""


@dataclass(frozen=True, eq=False)
class RecallChoice:
    """A finite set of candidates, and what sets of them are worth.

    Attributes:
        model: the objects and their curves.
        seen: what each candidate hits, from `model.objects.seen_by`.
        weights: weight of each class, not negative; classes without weight do not count.

    Raises:
        ValueError: a weight is negative or not finite, or of a class that `model` does not have.
    """

    model: ExpectedRecall
    seen: Sequence[SurfaceCells]
    weights: Mapping[str, float]

    def __post_init__(self) -> None:
        for name, weight in self.weights.items():
            if name not in self.model.classes:
                known = ", ".join(self.model.classes)
                raise ValueError(f"weights has {name!r}, but the classes are {known}")
            if not 0 <= weight < np.inf:
                raise ValueError(f"the weight of {name} must be finite and >= 0, found {weight}")

    def value(self, chosen: Sequence[int]) -> float:
        """The value of a set of candidates."""
        return float(self._found(self._cells(self._hit(self._all_of(chosen)))).sum())

    def gains(self, chosen: Sequence[int] = ()) -> NDArray[np.float64]:
        """What each candidate adds to the set `chosen`, shape (candidates,)."""
        return np.asarray(self._cut_of_set(chosen).slopes.sum(axis=0))

    def greedy(self, limits: Limits) -> Greedy:
        """Choose candidates one by one; `lidarplace.pog.selection.greedy` tells how good that is.

        Raises:
            ValueError: `limits` are of another number of candidates.
        """
        self._check(limits)

        def added_to(chosen: Sequence[int]) -> Added:
            hit = self._hit(self._all_of(chosen))
            cells = self._cells(hit)
            before = self._found(cells).sum()
            return lambda one: float(self._found(cells + self._further(one, hit)).sum() - before)

        return lazy_greedy(self.gains(), added_to, limits)

    def upper_bound(
        self,
        limits: Limits,
        chosen: Sequence[int] = (),
        seconds: float = 60.0,
        relative_gap: float = 1e-4,
    ) -> UpperBound:
        """No set that `limits` allow is worth more.

        Args:
            chosen: candidates in the order of `greedy`. Of each of its prefixes, what all others
                add to it makes the first cuts (Nemhauser and Wolsey 1981, Maximizing submodular
                set functions: formulations and analysis of algorithms).
            seconds, relative_gap: as of `lidarplace.pog.selection.upper_bound`.

        Raises:
            ValueError: `limits` are of another number of candidates.
        """
        self._check(limits)
        first = (self._cut_of_set(chosen[:size]) for size in range(len(chosen) + 1))
        return bound_by_cuts(first, self._tangent, limits, seconds, relative_gap)

    def _check(self, limits: Limits) -> None:
        if limits.candidates != len(self.seen):
            raise ValueError(
                f"limits are for {limits.candidates} candidates, there are {len(self.seen)}"
            )

    @cached_property
    def _first_cell(self) -> NDArray[np.int64]:
        """Number of the first cell of each object among those of all, shape (objects + 1,)."""
        objects = self.model.objects
        number = slices_of(objects.geometry, objects.cell).prod(axis=1)
        return np.concatenate([[0], np.cumsum(number)])

    @cached_property
    def _worth(self) -> NDArray[np.float64]:
        """Weight of the class of every object, by the number of its objects."""
        of_class = self.model.objects.table["class"]
        weights = of_class.map(dict(self.weights)).fillna(0.0).to_numpy(np.float64)
        return weights / of_class.map(of_class.value_counts()).to_numpy(np.float64)

    def _all_of(self, chosen: Sequence[int]) -> NDArray[np.float64]:
        """Shares of the candidates: 1 of those that are chosen."""
        share = np.zeros(len(self.seen))
        share[list(chosen)] = 1.0
        return share

    def _hit(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum of the shares of the candidates that hit each cell, shape (cells of all objects,)."""
        hit = np.zeros(self._first_cell[-1])
        for one in np.flatnonzero(share).tolist():
            _add(self.seen[one].offsets, self.seen[one].cells, self._first_cell, share[one], hit)
        return hit

    def _cells(self, hit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Cells of every object, each by how much of it is hit, shape (objects,)."""
        if not len(hit):
            return np.zeros(0)
        return np.add.reduceat(np.minimum(hit, 1.0), self._first_cell[:-1])

    def _further(self, one: int, hit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Cells of every object that a candidate adds to those that are hit, shape (objects,)."""
        return _not_hit(self.seen[one].offsets, self.seen[one].cells, self._first_cell, hit)

    def _found(self, cells: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the objects contribute to the value, by their distinct cells, shape (objects,)."""
        return self._worth * self.model.found(cells)

    def _cut_of_set(self, chosen: Sequence[int]) -> Cut:
        """What each candidate adds to a set, and what the set is worth, by blocks."""
        hit = self._hit(self._all_of(chosen))
        cells = self._cells(hit)
        before = self._found(cells)
        slopes = self._by_all(lambda one: self._found(cells + self._further(one, hit)) - before)
        return Cut(_in_blocks(before), slopes)

    def _tangent(self, share: NDArray[np.float64]) -> Cut:
        """The cut that touches the value where `share` of each candidate is chosen."""
        hit = self._hit(share)
        cells = self._cells(hit)
        slope = self._worth * self.model.most * self.model.rate * np.exp(-self.model.rate * cells)
        whole = self._cells(np.floor(hit))
        constant = self._found(cells) + slope * (whole - cells)
        slopes = self._by_all(lambda one: slope * self._further(one, hit))
        return Cut(_in_blocks(constant), slopes)

    def _by_all(self, of_one: Callable[[int], NDArray[np.float64]]) -> NDArray[np.float64]:
        """A quantity of the objects for every candidate, by blocks, shape (blocks, candidates)."""
        with ThreadPoolExecutor(numba.get_num_threads()) as threads:
            rows = threads.map(lambda one: _in_blocks(of_one(one)), range(len(self.seen)))
            return np.array(list(rows)).reshape(-1, BLOCKS).T


def _in_blocks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums over `BLOCKS` parts of the objects."""
    block = np.arange(len(values)) * BLOCKS // max(1, len(values))
    return np.bincount(block, values, BLOCKS).astype(np.float64)


@njit(cache=True, nogil=True)
def _add(offsets, cells, first_cell, share, hit):  # pragma: no cover - compiled
    """Add a share to each cell of a candidate."""
    for row in range(len(offsets) - 1):
        for n in range(offsets[row], offsets[row + 1]):
            hit[first_cell[row] + cells[n]] += share


@njit(cache=True, nogil=True)
def _not_hit(offsets, cells, first_cell, hit) -> NDArray[np.float64]:  # pragma: no cover - compiled
    """Number of a candidate's cells of every object of which less than 1 is hit."""
    further = np.zeros(len(offsets) - 1)
    for row in range(len(further)):
        for n in range(offsets[row], offsets[row + 1]):
            further[row] += hit[first_cell[row] + cells[n]] < 1.0
    return further

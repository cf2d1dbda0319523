"""Choice of mounts from many candidates: greedy, by `expected_recall`, and its bound.

The value of a set is a weighted sum of `expected_recall` over classes. The cells that a set hits
are a union and every detection curve is concave, so it is monotone and submodular.

At shares of the candidates between 0 and 1 a cell is hit by the sum of the shares of those that hit
it, at most 1. The curve of the sum over cells is concave in the shares, and the value where they
are 0 or 1: tangents of it are cuts."""

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
from lidarplace.pog.selection.submodular import Added, SubmodularChoice, check_weights
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.recall.surface_cells import SurfaceCells, slices_of


@dataclass(frozen=True, eq=False)
class RecallChoice(SubmodularChoice):
    """Candidates by the objects that they find.

    Attributes:
        model: the objects and their curves.
        seen: what each candidate hits, from `model.objects.seen_by`.
        weights: weight of each class of `model`, finite and not negative; without one it does not
            count."""

    model: ExpectedRecall
    seen: Sequence[SurfaceCells]
    weights: Mapping[str, float]

    def __post_init__(self) -> None:
        check_weights(self.weights, self.model.classes)

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return len(self.seen)

    def value(self, chosen: Sequence[int]) -> float:
        """Return the value of a set of candidates."""
        return float(self._found(self._cells(self._hit(self._all_of(chosen)))).sum())

    def _added_to(self, chosen: Sequence[int]) -> Added:
        hit = self._hit(self._all_of(chosen))
        cells = self._cells(hit)
        before = self._found(cells).sum()
        return lambda one: float(self._found(cells + self._further(one, hit)).sum() - before)

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
        """Return shares of the candidates: 1 of those that are chosen."""
        share = np.zeros(len(self.seen))
        share[list(chosen)] = 1.0
        return share

    def _hit(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum up the shares of the candidates that hit each cell, shape (cells of all objects,)."""
        hit = np.zeros(self._first_cell[-1])
        for one in np.flatnonzero(share).tolist():
            _add(self.seen[one].offsets, self.seen[one].cells, self._first_cell, share[one], hit)
        return hit

    def _cells(self, hit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cells of every object, each by how much of it is hit, shape (objects,)."""
        if not len(hit):
            return np.zeros(0)
        return np.add.reduceat(np.minimum(hit, 1.0), self._first_cell[:-1])

    def _further(self, one: int, hit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cells of every object that a candidate adds, shape (objects,)."""
        return _not_hit(self.seen[one].offsets, self.seen[one].cells, self._first_cell, hit)

    def _found(self, cells: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share of each object in the value, by its distinct cells, shape (objects,)."""
        return self._worth * self.model.found(cells)

    def _cut_of_set(self, chosen: Sequence[int], blocks: int) -> Cut:
        hit = self._hit(self._all_of(chosen))
        cells = self._cells(hit)
        before = self._found(cells)
        return self._cut(
            before, lambda one: self._found(cells + self._further(one, hit)) - before, blocks
        )

    def _tangent(self, share: NDArray[np.float64], blocks: int) -> Cut:
        """Return the cut that touches the value where `share` of each candidate is chosen."""
        hit = self._hit(share)
        cells = self._cells(hit)
        slope = self._worth * self.model.most * self.model.rate * np.exp(-self.model.rate * cells)
        whole = self._cells(np.floor(hit))
        constant = self._found(cells) + slope * (whole - cells)
        return self._cut(constant, lambda one: slope * self._further(one, hit), blocks)

    def _cut(
        self,
        constant: NDArray[np.float64],
        of_one: Callable[[int], NDArray[np.float64]],
        blocks: int,
    ) -> Cut:
        """Return a cut from a constant of the objects, and a slope of them for every candidate."""
        block = np.arange(len(constant)) * blocks // max(1, len(constant))

        def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.bincount(block, values, blocks).astype(np.float64)

        with ThreadPoolExecutor(numba.get_num_threads()) as threads:
            rows = list(threads.map(lambda one: sums(of_one(one)), range(len(self.seen))))
        return Cut(sums(constant), np.array(rows).reshape(-1, blocks).T)


@njit(cache=True, nogil=True)
def _add(offsets, cells, first_cell, share, hit):
    """Add a share to each cell of a candidate."""
    for row in range(len(offsets) - 1):
        for n in range(offsets[row], offsets[row + 1]):
            hit[first_cell[row] + cells[n]] += share


@njit(cache=True, nogil=True)
def _not_hit(offsets, cells, first_cell, hit) -> NDArray[np.float64]:
    """Count a candidate's cells of every object of which less than 1 is hit."""
    further = np.zeros(len(offsets) - 1)
    for row in range(len(further)):
        for n in range(offsets[row], offsets[row + 1]):
            further[row] += hit[first_cell[row] + cells[n]] < 1.0
    return further

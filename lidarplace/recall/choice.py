"""Which of many candidate mounts find most: greedy choice by `expected_recall`, and its bound.

The value of a set is a weighted sum of `expected_recall` over classes. The cells that a set hits
are a union and every detection curve is concave, so it is monotone and submodular.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.recall.surface_cells import SurfaceCells
from lidarplace.selection.cuts import Cut, highest
from lidarplace.selection.greedy import Added, Greedy, lazy_greedy
from lidarplace.selection.limits import Limits

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
        return float(self._found(self._of_set(chosen).counts()).sum())

    def gains(self, chosen: Sequence[int] = ()) -> NDArray[np.float64]:
        """What each candidate adds to the set `chosen`, shape (candidates,)."""
        return self._added_by_all(chosen).sum(axis=1)

    def greedy(self, limits: Limits) -> Greedy:
        """Choose candidates one by one; `lidarplace.selection.greedy` tells how good that is.

        Raises:
            ValueError: `limits` are of another number of candidates.
        """
        self._check(limits)

        def added_to(chosen: Sequence[int]) -> Added:
            seen = self._of_set(chosen)
            before = self._found(seen.counts()).sum()
            return lambda one: float(self._found(seen.counts_with(self.seen[one])).sum() - before)

        return lazy_greedy(self.gains(), added_to, limits)

    def upper_bound(self, limits: Limits, chosen: Sequence[int] = ()) -> float:
        """No set that `limits` allow is worth more.

        Args:
            chosen: candidates in the order of `greedy`. Of each of its prefixes, what all others
                add to it makes cuts (Nemhauser and Wolsey 1981, Maximizing submodular set
                functions: formulations and analysis of algorithms).

        Raises:
            ValueError: `limits` are of another number of candidates.
        """
        self._check(limits)
        cuts = []
        for size in range(len(chosen) + 1):
            prefix = chosen[:size]
            constant = self._found(self._of_set(prefix).counts())
            cuts.append(Cut(_in_blocks(constant), _in_blocks(self._added_by_all(prefix)).T))
        return highest(cuts, limits)[0] * (1 + 1e-10)

    def _check(self, limits: Limits) -> None:
        if limits.candidates != len(self.seen):
            raise ValueError(
                f"limits are for {limits.candidates} candidates, there are {len(self.seen)}"
            )

    def _of_set(self, chosen: Sequence[int]) -> SurfaceCells:
        nothing = SurfaceCells.none(len(self.model.objects.table))
        return reduce(SurfaceCells.and_, [self.seen[one] for one in chosen], nothing)

    def _found(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """What the objects contribute to the value, by their distinct cells, shape (objects,)."""
        return self._worth * self.model.found(cells)

    @cached_property
    def _worth(self) -> NDArray[np.float64]:
        """Weight of the class of every object, by the number of its objects."""
        of_class = self.model.objects.table["class"]
        weights = of_class.map(dict(self.weights)).fillna(0.0).to_numpy(np.float64)
        return weights / of_class.map(of_class.value_counts()).to_numpy(np.float64)

    def _added_by_all(self, chosen: Sequence[int]) -> NDArray[np.float64]:
        """What each candidate adds to a set by objects, shape (candidates, objects)."""
        seen = self._of_set(chosen)
        before = self._found(seen.counts())
        rows = [self._found(seen.counts_with(one)) - before for one in self.seen]
        return np.array(rows).reshape(len(self.seen), len(before))


def _in_blocks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums over `BLOCKS` parts of the objects, the last axis."""
    parts = np.array_split(values, BLOCKS, axis=-1)
    return np.stack([part.sum(axis=-1) for part in parts], axis=-1)

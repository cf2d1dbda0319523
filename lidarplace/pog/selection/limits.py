"""Feasible sets of candidates: resources, budgets, and pairs that exclude each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Limits:
    """A set is feasible when it keeps all budgets and every two of its elements are compatible.

    `used` is how much of each resource a candidate uses (its LiDARs, its price, 1 if it is of a
    kind), not negative, shape (resources, candidates); `budgets` the most of each that may be used;
    `compatible` which candidates may be chosen together, symmetric, shape (candidates, candidates),
    None: all."""

    used: NDArray[np.float64]
    budgets: NDArray[np.float64]
    compatible: NDArray[np.bool_] | None = None

    @classmethod
    def at_most(cls, number: int, candidates: int) -> Limits:
        """Return limits to `number` of the `candidates`, whichever they are."""
        return cls(np.ones((1, candidates)), np.array([float(number)]))

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return int(self.used.shape[1])

    @cached_property
    def capacity(self) -> NDArray[np.float64]:
        """The budgets, and what rounding may add to a sum that keeps them, shape (resources,)."""
        return self.budgets + 1e-9 * np.maximum(1.0, self.budgets)

    @cached_property
    def share(self) -> NDArray[np.float64]:
        """Largest share of a budget that each candidate takes, shape (candidates,)."""
        if not len(self.budgets):
            return np.zeros(self.candidates)
        return np.asarray((self.used / self.capacity[:, None]).max(axis=0))

    def allows(self, chosen: list[int], candidate: int) -> bool:
        """Return whether `candidate` may join the set `chosen`, which is feasible."""
        if self.compatible is not None and not self.compatible[candidate, chosen].all():
            return False
        used = self.used[:, chosen].sum(axis=1) + self.used[:, candidate]
        return bool((used <= self.capacity).all())

    @cached_property
    def polytope(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """A and b so that every feasible set has `A x <= b`, x in {0, 1}.

        Besides the budgets there is a row for each clique of candidates that exclude each other;
        the cliques are found greedily. A candidate that no budget allows alone has a row `x <=
        0`."""
        rows, bounds = list(self.used), list(self.capacity)
        if self.compatible is not None:
            for clique in _cliques(self.compatible):
                if len(clique) > 1:
                    rows.append(np.zeros(self.candidates))
                    rows[-1][clique] = 1.0
                    bounds.append(1.0)
        impossible = (self.used > self.capacity[:, None]).any(axis=0)
        if impossible.any():
            rows.append(impossible.astype(np.float64))
            bounds.append(0.0)
        return np.array(rows).reshape(len(rows), self.candidates), np.array(bounds)


def _cliques(compatible: NDArray[np.bool_]) -> list[list[int]]:
    """Return sets of candidates, each excluding all others of its set; each candidate is in one."""
    cliques: list[list[int]] = []
    for candidate in range(len(compatible)):
        for clique in cliques:
            if not compatible[candidate, clique].any():
                clique.append(candidate)
                break
        else:
            cliques.append([candidate])
    return cliques

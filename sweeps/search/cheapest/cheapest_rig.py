"""The cheapest rig of a grid, and how far that is proven."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from sweeps.search.problem.rig import Rig

TOLERANCE = 1e-6
"""Rounding of the solver: shares of the need, and of costs."""


@dataclass(frozen=True)
class CheapestResult:
    """The cheapest rig of a grid; its rig is None if there is none.

    Attributes:
        cost: of the rig; infinite without one.
        bound: lowest cost of every rig of the grid; infinite where none meets everything.
        fewest: LiDARs that every rig of the grid with that cost has at least; 0: not known.
        closest: the checked rig that lacks least.
        value: of the detector, percent; None without one.
        counts: numbers of candidates, objects, rounds, rows, cuts and checked rigs."""

    rig: Rig | None
    cost: float
    bound: float
    fewest: float
    closest: Rig | None
    seconds: float
    value: float | None = None
    counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def gap(self) -> float:
        """Share of its cost by which the rig may be dearer than the cheapest; 0: proven."""
        if reaches(self.bound, self.cost):
            return 0.0
        return 1.0 - max(self.bound, 0.0) / self.cost if self.cost < math.inf else math.inf


def reaches(bound: float, cost: float) -> bool:
    """Return whether no rig is cheaper."""
    return bound >= cost - TOLERANCE * max(1.0, abs(cost))


Recall = Callable[[Rig], float]
"""Recall of a detector with a rig, percent."""

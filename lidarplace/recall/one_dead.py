"""What sets of candidates find when the LiDAR is dead whose loss costs most.

The least, over the LiDARs of a set, of the value without it is monotone, yet not submodular: two
LiDARs that see the same are worth nothing each, and together what either of them finds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lidarplace.recall.choice import RecallChoice
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.recall.surface_cells import SurfaceCells


@dataclass(frozen=True, eq=False)
class OneDeadChoice:
    """A finite set of candidates, one LiDAR or several each; `of` makes it.

    Attributes:
        whole: the candidates while all of their LiDARs work.
        lidars: their LiDARs one by one.
        parts: numbers of the LiDARs of each candidate.
    """

    whole: RecallChoice
    lidars: RecallChoice
    parts: Sequence[Sequence[int]]

    @classmethod
    def of(
        cls,
        model: ExpectedRecall,
        seen: Sequence[Sequence[SurfaceCells]],
        weights: Mapping[str, float],
    ) -> OneDeadChoice:
        """Candidates by what each of their LiDARs hits, at least one each; `RecallChoice`."""
        edges = np.cumsum([0, *map(len, seen)]).tolist()
        return cls(
            RecallChoice(model, [reduce(SurfaceCells.and_, own) for own in seen], weights),
            RecallChoice(model, [one for own in seen for one in own], weights),
            [range(*ends) for ends in pairwise(edges)],
        )

    def value(self, chosen: Sequence[int]) -> float:
        """The value of a set of candidates; 0 of a single LiDAR."""
        lidars = [number for one in chosen for number in self.parts[one]]
        left = ([*lidars[:i], *lidars[i + 1 :]] for i in range(len(lidars)))
        return min(map(self.lidars.value, left), default=0.0)

    def gains(self, chosen: Sequence[int] = ()) -> NDArray[np.float64]:
        """What each candidate adds to the set `chosen`, shape (candidates,)."""
        before = self.value(chosen)
        return np.array([self.value([*chosen, one]) - before for one in range(len(self.parts))])

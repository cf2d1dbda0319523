"""Choice among candidates whose value is monotone and submodular: greedy sets, and an upper bound.

Greedy choice is lazy: as a candidate's gain only falls while the set grows, it is computed again
only if it can still be the best (Minoux 1978, Accelerated greedy algorithms for maximizing
submodular set functions).

The upper bound is by cutting planes (Kelley 1960). Cuts are linear functions of the chosen
candidates that no set exceeds. A linear program takes the largest value that all cuts allow on the
polytope of `Limits`, at shares of the candidates between 0 and 1; where it lies a new cut is made.
The first cuts are those of greedy's prefixes. One of them alone, over the same polytope, is the
bound by marginal gains (Leskovec et al. 2007, Cost-effective outbreak detection in networks)."""

from __future__ import annotations

import heapq
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.pog.selection.cuts import Cut, highest
from lidarplace.pog.selection.limits import Limits

BLOCKS = 32
"""Parts of what is seen that have cuts of their own: the sum of their least cuts is lower than the
least of their sums."""
_ROUNDING = 1e-10
"""Relative; sums of float64 are right to 1e-12, see `Majorant`."""
Added = Callable[[int], float]
"""Function of a candidate: its gain, added to a set."""


@dataclass(frozen=True, eq=False)
class Greedy:
    """Candidates in the order in which they were chosen.

    After the last of those `chosen`, none adds anything or none is allowed; `gains` are what each
    added, `values` the value after it, `evaluations` the marginal gains that were computed, those
    of both rules. By `rule` the gain of each candidate among those allowed was largest, or its gain
    by the largest share of a budget that it takes."""

    chosen: tuple[int, ...]
    gains: NDArray[np.float64]
    values: NDArray[np.float64]
    evaluations: int
    rule: Literal["gain", "gain per cost"]

    @property
    def value(self) -> float:
        """Value of the chosen set."""
        return float(self.values[-1]) if len(self.values) else 0.0


@dataclass(frozen=True, eq=False)
class UpperBound:
    """Bound that the value of no feasible set exceeds.

    `by_gains` is the best bound by marginal gains alone, `history` the best so far after every
    round: columns `seconds`, `bound`, `kind` (`gains` or `cuts`)."""

    value: float
    by_gains: float
    history: pd.DataFrame


class SubmodularChoice(ABC):
    """A finite set of candidates, and what sets of them are worth."""

    @property
    @abstractmethod
    def candidates(self) -> int:
        """Number of candidates."""

    @abstractmethod
    def value(self, chosen: Sequence[int]) -> float:
        """Return the value of a set of candidates."""

    @abstractmethod
    def _added_to(self, chosen: Sequence[int]) -> Added:
        """Return a function of a further candidate: its gain, added to a set."""

    @abstractmethod
    def _cut_of_set(self, chosen: Sequence[int], blocks: int) -> Cut:
        """Return the gain of each candidate, added to a set, and its value, by blocks."""

    @abstractmethod
    def _tangent(self, share: NDArray[np.float64], blocks: int) -> Cut:
        """Return a cut that is low where `share` of each candidate, (candidates,), is chosen."""

    def gains(self, chosen: Sequence[int] = ()) -> NDArray[np.float64]:
        """Return the gain of each candidate, added to the set `chosen`, shape (candidates,)."""
        return np.asarray(self._cut_of_set(chosen, 1).slopes[0])

    def greedy(self, limits: Limits) -> Greedy:
        """Choose candidates one by one; the same for the same input, ties go to the lower number.

        Where candidates take different shares of the budgets, the better result of both rules is
        taken. If the only limit is a number of candidates, the value is at least 1 - 1/e of the
        best (Nemhauser, Wolsey and Fisher 1978, An analysis of approximations for maximizing
        submodular set functions I); else there is no such guarantee, and `upper_bound` tells the
        gap. Raises ValueError if `limits` are of another number of candidates."""
        self._check(limits)
        singles = self.gains()
        by_gain = self._lazily(singles, limits, np.ones(len(singles)), "gain")
        if len(singles) == 0 or np.ptp(limits.share) == 0:
            return by_gain
        # A candidate that takes nothing costs next to nothing.
        cost = np.maximum(limits.share, 1e-12)
        per_cost = self._lazily(singles, limits, cost, "gain per cost")
        best = per_cost if per_cost.value > by_gain.value else by_gain
        evaluations = by_gain.evaluations + per_cost.evaluations - len(singles)
        return replace(best, evaluations=evaluations)

    def _lazily(
        self,
        singles: NDArray[np.float64],
        limits: Limits,
        cost: NDArray[np.float64],
        rule: Literal["gain", "gain per cost"],
    ) -> Greedy:
        chosen: list[int] = []
        added: list[float] = []
        added_now = self._added_to(chosen)
        evaluations = len(singles)
        # Largest known gain first, then the lower number; and the size of the set it is of.
        numbered = enumerate(singles.tolist())
        heap = [(-gain / cost[e], e, 0, gain) for e, gain in numbered if gain > 0]
        heapq.heapify(heap)
        while heap:
            _, candidate, size, gain = heapq.heappop(heap)
            if not limits.allows(chosen, candidate):
                continue  # nor will it ever be: sets only grow
            if size < len(chosen):
                gain = added_now(candidate)
                evaluations += 1
                if gain > 0:
                    heapq.heappush(heap, (-gain / cost[candidate], candidate, len(chosen), gain))
                continue
            chosen.append(candidate)
            added_now = self._added_to(chosen)
            added.append(gain)
        return Greedy(tuple(chosen), np.array(added), np.cumsum(added), evaluations, rule)

    def upper_bound(
        self,
        limits: Limits,
        chosen: Sequence[int] = (),
        seconds: float = 60.0,
        relative_gap: float = 1e-4,
        blocks: int = BLOCKS,
    ) -> UpperBound:
        """Return a bound on the value of every set of candidates that `limits` allow.

        `chosen` are candidates in the order of `greedy`: what all others add to each of its
        prefixes makes the first cuts (Nemhauser and Wolsey 1981, Maximizing submodular set
        functions: formulations and analysis of algorithms). No round starts after `seconds`, nor if
        the bound is within `relative_gap` of the best that cuts can reach. A round makes a cut for
        each of `blocks` of what is seen."""
        self._check(limits)
        start = time.perf_counter()
        history: list[tuple[float, float, str]] = []
        cuts: list[Cut] = []

        def note(bound: float, kind: str) -> float:
            best = min([bound * (1 + _ROUNDING), *(earlier for _, earlier, _ in history)])
            history.append((time.perf_counter() - start, best, kind))
            return best

        for size in range(len(chosen) + 1):
            cut = self._cut_of_set(chosen[:size], blocks)
            cut.slopes[:, list(chosen[:size])] = 0.0  # these add nothing more
            cuts.append(cut)
            whole = Cut(cut.constant.sum(keepdims=True), cut.slopes.sum(0, keepdims=True))
            by_gains = note(highest([whole], limits)[0], "gains")
        best = by_gains
        best_share, reached = np.zeros(limits.candidates), 0.0
        while time.perf_counter() - start < seconds:
            bound, share = highest(cuts, limits)
            best = note(bound, "cuts")
            if best - reached <= relative_gap * best:
                break
            # Halfway to the best point known the cuts settle sooner than at the corner.
            share = (share + best_share) / 2
            cuts.append(self._tangent(share, blocks))
            value = float((cuts[-1].constant + cuts[-1].slopes @ share).sum())
            if value > reached:
                best_share, reached = share, value
        table = pd.DataFrame(history, columns=["seconds", "bound", "kind"])
        return UpperBound(best, by_gains, table)

    def _check(self, limits: Limits) -> None:
        if limits.candidates != self.candidates:
            count = f"{self.candidates} candidates"
            raise InputError(key="limits", expected=count, found=limits.candidates)


def check_weights(weights: Mapping[str, float], classes: Sequence[str]) -> None:
    """Raise ValueError for a weight of an unknown class, or one that is negative or not finite."""
    for name, weight in weights.items():
        if name not in classes:
            raise InputError(key="weights", expected=", ".join(classes), found=repr(name))
        if not 0 <= weight < np.inf:
            raise InputError(key=f"weights.{name}", expected="a finite number >= 0", found=weight)

"""Greedy choice of candidates, lazily: a gain is computed again only if it can still be the best.

As the value is submodular a candidate's gain only falls while the set grows, so what it was
before is an upper bound (Minoux 1978, Accelerated greedy algorithms for maximizing submodular set
functions).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lidarplace.pog.selection.exposure import Exposure
from lidarplace.pog.selection.limits import Limits
from lidarplace.pog.selection.majorant import Majorant


@dataclass(frozen=True, eq=False)
class Greedy:
    """Candidates in the order in which they were chosen.

    Attributes:
        chosen: their numbers; none adds anything any more, or none is allowed, after the last.
        gains: what each added, shape (chosen,).
        values: value after each, shape (chosen,).
        evaluations: marginal gains that were computed, those of both rules.
        rule: what was largest of each candidate among those allowed: its gain, or its gain by
            the largest share of a budget that it takes.
    """

    chosen: tuple[int, ...]
    gains: NDArray[np.float64]
    values: NDArray[np.float64]
    evaluations: int
    rule: Literal["gain", "gain per cost"]

    @property
    def value(self) -> float:
        """Value of the chosen set."""
        return float(self.values[-1]) if len(self.values) else 0.0


def greedy(exposure: Exposure, limits: Limits) -> Greedy:
    """Choose candidates one by one; the same for the same input, ties go to the lower number.

    Where candidates take different shares of the budgets, both rules are tried and the better
    result is taken, the first if they are equal.

    If the only limit is a number of candidates, the value is at least 1 - 1/e of the best
    (Nemhauser, Wolsey and Fisher 1978, An analysis of approximations for maximizing submodular set
    functions I). With prices, sizes that differ or pairs that exclude each other there is no such
    guarantee: `upper_bound` tells how far the best can be.

    Raises:
        ValueError: `limits` are of another number of candidates.
    """
    if limits.candidates != exposure.candidates:
        raise ValueError(
            f"limits are for {limits.candidates} candidates, exposure has {exposure.candidates}"
        )

    def added_to(chosen: Sequence[int]) -> Added:
        set_so_far = Majorant.of_set(exposure, chosen)
        return lambda candidate: float(set_so_far.added(candidate)[0])

    return lazy_greedy(gains(exposure, ()), added_to, limits)


Added = Callable[[int], float]
"""What a candidate adds to a set."""


def lazy_greedy(
    singles: NDArray[np.float64], added_to: Callable[[Sequence[int]], Added], limits: Limits
) -> Greedy:
    """`greedy` for any value of sets that is monotone and submodular.

    Args:
        singles: value of every candidate by itself, shape (candidates,).
        added_to: of a set, what each further candidate adds to it.
        limits: of as many candidates.
    """
    by_gain = _greedy(singles, added_to, limits, np.ones(len(singles)), "gain")
    if len(singles) == 0 or np.ptp(limits.share) == 0:
        return by_gain
    # A candidate that takes nothing costs next to nothing.
    cost = np.maximum(limits.share, 1e-12)
    per_cost = _greedy(singles, added_to, limits, cost, "gain per cost")
    best = per_cost if per_cost.value > by_gain.value else by_gain
    evaluations = by_gain.evaluations + per_cost.evaluations - len(singles)
    return Greedy(best.chosen, best.gains, best.values, evaluations, best.rule)


def gains(exposure: Exposure, chosen: Sequence[int]) -> NDArray[np.float64]:
    """What each candidate adds to the set `chosen`, shape (candidates,)."""
    whole = np.array([0, len(exposure.gain.profile)])
    return np.asarray(Majorant.of_set(exposure, chosen).added_by_all(whole)[0])


def _greedy(
    singles: NDArray[np.float64],
    added_to: Callable[[Sequence[int]], Added],
    limits: Limits,
    cost: NDArray[np.float64],
    rule: Literal["gain", "gain per cost"],
) -> Greedy:
    chosen: list[int] = []
    added: list[float] = []
    added_now = added_to(chosen)
    evaluations = len(singles)
    # Largest known gain first, then the lower number; and the size of the set it was computed for.
    heap = [(-gain / cost[e], e, 0, gain) for e, gain in enumerate(singles.tolist()) if gain > 0]
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
        added_now = added_to(chosen)
        added.append(gain)
    return Greedy(tuple(chosen), np.array(added), np.cumsum(added), evaluations, rule)

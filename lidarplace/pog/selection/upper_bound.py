"""An upper bound of the value of every feasible set, by cutting planes (Kelley 1960).

`Majorant` gives linear functions of the chosen candidates that no set exceeds, the cuts. A linear
program takes the largest value that all cuts allow on the polytope of `Limits`, at shares of the
candidates between 0 and 1; where it lies a new cut is made. Blocks of voxels have cuts of their
own, since the sum of their least cuts is lower than the least of their sums.

The first cuts are those of greedy's prefixes. One of them alone, over the same polytope, is the
bound by marginal gains (Leskovec et al. 2007, Cost-effective outbreak detection in networks).
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.pog.selection.cuts import Cut, highest
from lidarplace.pog.selection.exposure import Exposure
from lidarplace.pog.selection.limits import Limits
from lidarplace.pog.selection.majorant import Majorant

_ROUNDING = 1e-10
"""Relative; sums of float64 are right to 1e-12, see `Majorant`."""


@dataclass(frozen=True, eq=False)
class UpperBound:
    """No feasible set has a larger value.

    Attributes:
        value: the bound.
        by_gains: the best bound by marginal gains alone.
        history: the best bound so far after every round; columns `seconds`, `bound`, `kind`
            (`gains` or `cuts`).
    """

    value: float
    by_gains: float
    history: pd.DataFrame


def upper_bound(
    exposure: Exposure,
    limits: Limits,
    chosen: Sequence[int] = (),
    seconds: float = 60.0,
    relative_gap: float = 1e-4,
    blocks: int = 32,
) -> UpperBound:
    """Bound the value of every set of candidates that `limits` allow.

    Args:
        chosen: candidates in the order of `greedy`, whose prefixes give the first cuts.
        seconds: no round starts later.
        relative_gap: stop when the bound is this close to the best that cuts can reach.
        blocks: of voxels, as many cuts a round.

    Raises:
        ValueError: `limits` are of another number of candidates.
    """
    if limits.candidates != exposure.candidates:
        raise ValueError(
            f"limits are for {limits.candidates} candidates, exposure has {exposure.candidates}"
        )
    edges = np.linspace(0, len(exposure.gain.profile), blocks + 1).astype(np.int64)

    def of_prefix(size: int) -> Cut:
        cut = _of_majorant(Majorant.of_set(exposure, chosen[:size]), edges)
        cut.slopes[:, list(chosen[:size])] = 0.0  # these add nothing more
        return cut

    def at(share: NDArray[np.float64]) -> Cut:
        return _of_majorant(Majorant.at(exposure, share), edges)

    return bound_by_cuts(map(of_prefix, range(len(chosen) + 1)), at, limits, seconds, relative_gap)


def bound_by_cuts(
    first: Iterable[Cut],
    at: Callable[[NDArray[np.float64]], Cut],
    limits: Limits,
    seconds: float,
    relative_gap: float,
) -> UpperBound:
    """`upper_bound` for any value of sets that has cuts.

    Args:
        first: cuts to begin with, at least one: those of greedy's prefixes.
        at: a cut that is low where shares of the candidates are chosen, shape (candidates,).
        limits, seconds, relative_gap: as there.
    """
    start = time.perf_counter()
    history: list[tuple[float, float, str]] = []
    cuts: list[Cut] = []

    def note(bound: float, kind: str) -> float:
        best = min([bound * (1 + _ROUNDING), *(known for _, known, _ in history)])
        history.append((time.perf_counter() - start, best, kind))
        return best

    for cut in first:
        cuts.append(cut)
        whole = Cut(cut.constant.sum(keepdims=True), cut.slopes.sum(0, keepdims=True))
        by_gains = note(highest([whole], limits)[0], "gains")
    best = by_gains
    middle, reached = np.zeros(limits.candidates), 0.0
    while time.perf_counter() - start < seconds:
        bound, share = highest(cuts, limits)
        best = note(bound, "cuts")
        if best - reached <= relative_gap * best:
            break
        # Halfway to the best point known the cuts settle sooner than at the corner.
        share = (share + middle) / 2
        cuts.append(at(share))
        value = float((cuts[-1].constant + cuts[-1].slopes @ share).sum())
        if value > reached:
            middle, reached = share, value
    return UpperBound(best, by_gains, pd.DataFrame(history, columns=["seconds", "bound", "kind"]))


def _of_majorant(majorant: Majorant, edges: NDArray[np.int64]) -> Cut:
    constant = [majorant.constant[a:b].sum() for a, b in itertools.pairwise(edges)]
    return Cut(np.array(constant), majorant.added_by_all(edges))

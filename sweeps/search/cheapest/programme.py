"""The mixed-integer programme: one 0/1 unknown a candidate, and the rows that are known so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array, diags_array, hstack

_INFEASIBLE = 2
"""HiGHS' status."""


class Position(NamedTuple):
    """Where a requirement may fail in a case, `of`, which identifies both: so many of its positions
    may, or so many `of_each` LiDAR of the rig."""

    of: tuple[object, ...]
    number: int
    may_fail: int
    of_each: bool


@dataclass(frozen=True, eq=False)
class Row:
    """`gains · x + base`, shares of what is needed, is at least 1, or as much as `position` has to
    have, where some may fail."""

    gains: NDArray[np.float64]
    base: float
    position: Position | None = None


@dataclass(frozen=True)
class Solution:
    """What the solver found: numbers of candidates, None where it found none in time, or there is
    none; what no choice that keeps the rows costs less than, infinite where none keeps them; and
    positions that are given up."""

    chosen: tuple[int, ...] | None
    bound: float
    failing: frozenset[Position] = frozenset()


@dataclass(eq=False)
class Programme:
    """Least cost of a choice of candidates. Each row that is added holds for every rig allowed.

    Attributes:
        costs: of each candidate; they add up, or with `of_highest` the largest one counts, and of
            equal ones the number of LiDARs.
        sizes: LiDARs of each candidate.
        used, least, most: sums of `used`, shape (resources, candidates), and their limits.
        fixed: whether a candidate is part of every rig.
        base: what every rig costs besides.
        rows, cuts: see `Row` and `cut`.
        exactly: solve to the end; else a choice may be dearer than the cheapest by less than costs
            differ.
    """

    costs: NDArray[np.float64]
    sizes: NDArray[np.float64]
    used: NDArray[np.float64]
    least: NDArray[np.float64]
    most: NDArray[np.float64]
    fixed: NDArray[np.bool_]
    of_highest: bool = False
    base: float = 0.0
    rows: list[Row] = field(default_factory=list)
    cuts: list[tuple[NDArray[np.float64], float, float]] = field(default_factory=list)
    exactly: bool = False

    def __post_init__(self) -> None:
        whole = np.round(1000 * self.costs)
        even = (abs(1000 * self.costs - whole) < 1e-6).all()
        grain = float(np.gcd.reduce(whole.astype(np.int64))) / 1000 if even else 0.0
        self.grain = max(grain, 1e-9)
        self.last = 0.0

    def cut(self, weights: NDArray[np.float64], least: float, most: float = math.inf) -> None:
        """Keep a sum of weights of the chosen ones within limits."""
        self.cuts.append((weights, least, most))

    def cost(self, chosen: Sequence[int]) -> float:
        own = self.costs[list(chosen)]
        return self.base + float(own.max(initial=0.0) if self.of_highest else math.fsum(own))

    def of_number(self, cost: float) -> Programme:
        """The programme of the fewest LiDARs of choices that cost no more; shares rows and cuts."""
        programme = replace(self, costs=self.sizes, of_highest=False, base=0.0, exactly=False)
        if self.of_highest:
            programme.cut((self.costs > cost - self.base + 1e-9).astype(float), -math.inf, 0.0)
        else:
            programme.cut(self.costs, -math.inf, self._most(cost))
        return programme

    def _most(self, cost: float) -> float:
        return cost - self.base + 1e-6 * max(1.0, abs(cost))

    def solve(self, seconds: float, most: float | None = None, reach: float = 0.0) -> Solution:
        """The cheapest choice in so many seconds; or, of those that cost no more than `most`, the
        one with most to spare in the row that has least, up to `reach` times what is needed."""
        n = len(self.costs)
        positions = list(dict.fromkeys(row.position for row in self.rows if row.position))
        at = {position: n + 2 + number for number, position in enumerate(positions)}
        width = n + 2 + len(positions)  # candidates, the highest, what there is to spare, positions
        high = np.ones(width)
        high[n], high[n + 1] = math.inf, reach
        weights = np.array([*self.used, *(cut[0] for cut in self.cuts)])
        least = [*self.least, *(cut[1] for cut in self.cuts)]
        upper = [*(self.most + 1e-9), *(cut[2] for cut in self.cuts)]
        lines = [_lines(width, weights, least, upper)]
        # More than all that is needed counts as all of it: the relaxation is tighter.
        gains = [np.minimum(row.gains, max(0.0, 1.0 + reach - row.base)) for row in self.rows]
        asked = enumerate(row.position for row in self.rows)
        more = [(i, at[position], -1.0 - reach) for i, position in asked if position]
        more += [(i, n + 1, -1.0) for i in range(len(gains))]
        needed = [(-reach if row.position else 1.0) - row.base for row in self.rows]
        if gains:
            lines.append(_lines(width, np.array(gains), needed, more=more))
        for of in dict.fromkeys(position.of for position in positions):
            alike = [position for position in positions if position.of == of]
            fails, of_each = alike[0].may_fail, alike[0].of_each
            kept = fails * self.sizes if of_each else np.zeros(n)
            marks = [(0, at[position], 1.0) for position in alike]
            enough = [len(alike) - (0 if of_each else fails)]
            lines.append(_lines(width, kept[None], enough, more=marks))
        goal, scale = np.zeros(width), 1.0
        goal[:n], levels = self.costs, np.zeros(1)
        if self.of_highest:
            levels, ranks = np.unique(self.costs, return_inverse=True)
            scale = float(self.most[0] + self.sizes[self.fixed].sum() + 1.0)
            goal[:n], goal[n] = self.sizes, scale
            above = hstack([-diags_array(ranks.astype(float)), np.ones((n, 1))])
            lines.append(_lines(width, above, [0.0] * n))
        if most is not None:
            if self.of_highest:
                high[:n] *= self.costs <= most - self.base + 1e-9
            else:
                lines.append(_lines(width, goal[None], [-math.inf], self._most(most)))
            goal = np.zeros(width)
            goal[n + 1] = -1.0
        low = np.zeros(width)
        low[:n] = self.fixed
        kinds = np.ones(width)
        kinds[n : n + 2] = 0
        options = {"time_limit": max(seconds, 0.1), "mip_rel_gap": self._gap(most)}
        bounds = Bounds(low, high)
        found = milp(goal, integrality=kinds, bounds=bounds, constraints=lines, options=options)
        if found.status == _INFEASIBLE:
            return Solution(None, math.inf)
        bound = -math.inf if found.mip_dual_bound is None else float(found.mip_dual_bound)
        if self.of_highest and most is None and math.isfinite(bound):
            rank = math.ceil((bound - (scale - 1.0)) / scale - 1e-6)
            bound = float(levels[min(max(rank, 0), len(levels) - 1)])
        elif most is None and math.isfinite(bound):
            bound = self.last = self.grain * math.ceil(bound / self.grain - 1e-6)
        bound += self.base
        if found.x is None:
            return Solution(None, bound)
        chosen = tuple(np.flatnonzero(found.x[:n] > 0.5).tolist())
        off = frozenset(p for p, i in at.items() if found.x[i] < 0.5)
        return Solution(chosen, bound, off)

    def _gap(self, most: float | None) -> float:
        """How far the solver may stop before the end, a share of the cost."""
        if most is not None:
            return 0.05
        if self.exactly or self.of_highest:
            return 0.0
        return 0.4 * self.grain / max(self.last, self.grain)


def _lines(
    width: int,
    rows: Any,
    least: Sequence[float],
    most: Sequence[float] | float = math.inf,
    more: Sequence[tuple[int, int, float]] = (),
) -> LinearConstraint:
    """Limits of rows, filled with 0 to that width; `more`: row, column and number."""
    i, j, values = zip(*more, strict=True) if more else ((), (), ())
    rest = csr_array((values, (i, j)), shape=(rows.shape[0], width))
    rest += hstack([csr_array(rows), csr_array((rows.shape[0], width - rows.shape[1]))])
    return LinearConstraint(rest, least, most)

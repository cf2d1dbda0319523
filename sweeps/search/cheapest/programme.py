"""The mixed-integer programme: one 0/1 unknown a candidate, and the rows so far."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array, diags_array, hstack

_INFEASIBLE = 2
"""Status of HiGHS."""


class Position(NamedTuple):
    """A place where a requirement may fail in a case, `of`, which identifies both.

    So much of the `area` of its positions `may_fail`, or as much for `of_each` LiDAR of the rig."""

    of: tuple[object, ...]
    number: int
    area: float
    may_fail: float
    of_each: bool


@dataclass(frozen=True, eq=False)
class Row:
    """`gains · x + base`, shares of the need, is at least 1.

    If `position` may fail, it is at least as much as the position has to have."""

    gains: NDArray[np.float64]
    base: float
    position: Position | None = None


@dataclass(frozen=True)
class Solution:
    """Result of the solver.

    Attributes:
        chosen: numbers of candidates; None where it found none in time, or there is none.
        bound: lowest cost of choices that keep the rows; infinite where none keeps them.
        failing: positions that are given up."""

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
        used: uses of resources, shape (resources, candidates).
        least: lower limit of the sum of each resource.
        most: upper limit of the sum of each resource.
        fixed: whether a candidate is part of every rig.
        base: cost of every rig in addition.
        rows: see `Row`.
        cuts: see `cut`.
        exactly: solve to the end; else a choice may be dearer than the cheapest by less than costs
            differ."""

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
        """Return the cost of a choice."""
        costs = self.costs[list(chosen)]
        return self.base + float(costs.max(initial=0.0) if self.of_highest else math.fsum(costs))

    def of_number(self, cost: float) -> Programme:
        """Return the programme of the fewest LiDARs at no more cost; it shares rows and cuts."""
        programme = replace(self, costs=self.sizes, of_highest=False, base=0.0, exactly=False)
        if self.of_highest:
            programme.cut((self.costs > cost - self.base + 1e-9).astype(float), -math.inf, 0.0)
        else:
            programme.cut(self.costs, -math.inf, self._most(cost))
        return programme

    def _most(self, cost: float) -> float:
        return cost - self.base + 1e-6 * max(1.0, abs(cost))

    def solve(self, seconds: float, most: float | None = None, reach: float = 0.0) -> Solution:
        """Find the cheapest choice in so many seconds.

        With `most`: of choices that cost no more than that, the one with most to spare in the row
        that has least, up to `reach` times the need."""
        n = len(self.costs)
        positions = list(dict.fromkeys(row.position for row in self.rows if row.position))
        at = {position: n + 2 + number for number, position in enumerate(positions)}
        width = n + 2 + len(positions)  # candidates, the highest, what there is to spare, positions
        high = np.ones(width)
        high[n], high[n + 1] = math.inf, reach
        lines = self._constraints(width, at, reach)
        goal, scale = np.zeros(width), 1.0
        goal[:n], levels = self.costs, np.zeros(1)
        if self.of_highest:
            levels, ranks = np.unique(self.costs, return_inverse=True)
            scale = float(self.most[0] + self.sizes[self.fixed].sum() + 1.0)
            goal[:n], goal[n] = self.sizes, scale
            over = hstack([-diags_array(ranks.astype(float)), np.ones((n, 1))])
            lines.append(_lines(width, over, [0.0] * n))
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
        result = milp(goal, integrality=kinds, bounds=bounds, constraints=lines, options=options)
        if result.status == _INFEASIBLE:
            return Solution(None, math.inf)
        bound = -math.inf if result.mip_dual_bound is None else float(result.mip_dual_bound)
        if self.of_highest and most is None and math.isfinite(bound):
            rank = math.ceil((bound - (scale - 1.0)) / scale - 1e-6)
            bound = float(levels[min(max(rank, 0), len(levels) - 1)])
        elif most is None and math.isfinite(bound):
            bound = self.last = self.grain * math.ceil(bound / self.grain - 1e-6)
        bound += self.base
        if result.x is None:
            return Solution(None, bound)
        chosen = tuple(np.flatnonzero(result.x[:n] > 0.5).tolist())
        off = frozenset(p for p, i in at.items() if result.x[i] < 0.5)
        return Solution(chosen, bound, off)

    def _constraints(
        self, width: int, at: Mapping[Position, int], reach: float
    ) -> list[LinearConstraint]:
        """Return resources, cuts, rows and positions; `at`: column of each position."""
        n = len(self.costs)
        weights = np.array([*self.used, *(cut[0] for cut in self.cuts)])
        least = [*self.least, *(cut[1] for cut in self.cuts)]
        upper = [*(self.most + 1e-9), *(cut[2] for cut in self.cuts)]
        lines = [_lines(width, weights, least, upper)]
        if not self.rows:
            return lines
        # More than all that is needed counts as all of it: the relaxation is tighter.
        gains = [np.minimum(row.gains, max(0.0, 1.0 + reach - row.base)) for row in self.rows]
        more = [(i, at[r.position], -1.0 - reach) for i, r in enumerate(self.rows) if r.position]
        more += [(i, n + 1, -1.0) for i in range(len(gains))]
        needed = [(-reach if row.position else 1.0) - row.base for row in self.rows]
        lines.append(_lines(width, np.array(gains), needed, more=more))
        for of in dict.fromkeys(position.of for position in at):
            alike = [position for position in at if position.of == of]
            fails, of_each = alike[0].may_fail, alike[0].of_each
            failing = fails * self.sizes if of_each else np.zeros(n)
            marks = [(0, at[position], position.area) for position in alike]
            enough = [sum(p.area for p in alike) - (0.0 if of_each else fails) - 1e-6]
            lines.append(_lines(width, failing[None], enough, more=marks))
        return lines

    def _gap(self, most: float | None) -> float:
        """Return how far the solver may stop before the end, a share of the cost."""
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
    """Return limits of rows, filled with 0 to `width`; `more`: row, column and number."""
    i, j, values = zip(*more, strict=True) if more else ((), (), ())
    rest = csr_array((values, (i, j)), shape=(rows.shape[0], width))
    rest += hstack([csr_array(rows), csr_array((rows.shape[0], width - rows.shape[1]))])
    return LinearConstraint(rest, least, most)

"""The cheapest rig of a grid, with a proof.

The programme of `Programme` has a 0/1 unknown for each candidate and starts with few rows. Its best
choice is looked at, rows that it breaks are added, and it is solved again. Each row holds for every
rig that meets the requirements, so what the programme costs at least, every such rig does:

- Points add up over candidates. The row of an object: the sum is what is needed. More than all that
  is needed counts as all of it. Where some positions may fail, a 0/1 unknown of each one says
  whether it has to have enough.
- Cells, probabilities (which are numbers of cells) and coverage are unions, which are monotone and
  submodular: at a choice S the row is f(S) + the sum of what each candidate adds to S (Nemhauser
  and Wolsey).
- With m LiDARs dead the same rows hold without any m of them, and so without all candidates at m
  places, each of which has one LiDAR at most. If a rig of N has enough then, m + 1 of its LiDARs
  have 1 / (N - m) of it each, a row that cuts much more of the relaxation. Of several sensors by
  themselves a LiDAR counts where it has enough alone.
- Where no row is new, a cover cut: S grows while it still has too little, and some candidate that
  is not in it is needed.

So far LiDARs hide nothing from each other, which can only flatter a rig. A choice that keeps all
rows is judged exactly. If it fails, a cut excludes it and its like: without one of its LiDARs, or
with one that sees the place in question. Coverage, mounts that are off, and what a detector finds
exclude that very rig; LiDARs that others blind or cover exclude all that hold them.
Other choices of the same cost with the most to spare are tried first. The first rig that is judged
and costs what the programme does at least is the cheapest of the grid. Then the same rows, and a
limit on the cost, prove how many LiDARs such a rig has at least."""

import itertools
import math
import time
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from sweeps.configuration.objective import TOTALS
from sweeps.search.cheapest.blocks import Block, blocks_of
from sweeps.search.cheapest.cheapest_rig import TOLERANCE, CheapestResult, Recall, reaches
from sweeps.search.cheapest.programme import Position, Programme, Row
from sweeps.search.cheapest.rig_check import RigCheck, check_rig, cost_of
from sweeps.search.greedy.candidates import candidates_of, check_grid, limits_of
from sweeps.search.problem.constraints import Constraint, requirement_name
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig, ordered

_AT_ONCE = 12
"""Rows of a requirement that are added in a round."""
_SPARE_SECONDS = 5.0
_GROWING = ("blind_lidars", "body_share")
"""Constraints that further LiDARs can only break more."""


def check(problem: SearchProblem) -> str:
    """Check that there is a choice; return a line about it.

    Raises ValueError: the search has no grid or too large a one, no requirement, or the costs of
    its LiDARs are not known."""
    search, carrier, file = problem.file.search, problem.criteria.carrier, problem.path
    if search.greedy is None:
        grid = "a grid in zones, such as greedy: {position_step: 0.5}"
        raise InputError(place=file, key="search.greedy", expected=grid, found="none")
    if not (carrier.requirements or search.cheapest.recall):
        raise InputError(place=file, key="search.requirements", expected="at least 1", found="none")
    if (by := search.cheapest.by) in TOTALS:
        costs = [carrier.totals[by][model] for model in problem.space.models]
        if any(map(math.isnan, costs)) or not any([*costs, *carrier.mount_prices.values()]):
            key, expected = "search.cheapest.by", f"search.models with a {by} of each"
            unknown = dict(zip(problem.space.models, costs, strict=True))
            raise InputError(place=file, key=key, expected=expected, found=unknown)
    mounts = check_grid(problem)
    numbers = " to ".join(map(str, sorted({*problem.space.numbers})))
    return (
        f"least {by} of {numbers} LiDAR{'s' * (numbers != '1')}; models: "
        f"{len(problem.space.models)}, mounts of the grid: {mounts:,}, requirements: "
        f"{len(carrier.requirements)}"
    )


def cheapest(problem: SearchProblem, recall: Recall | None = None) -> CheapestResult:
    """Choose from the grid of the search, for at most `search.cheapest.seconds`.

    `recall`: has to be at least `search.cheapest.recall`; None: no limit. Raises ValueError: the
    grid is too large."""
    start = time.monotonic()
    candidates = candidates_of(problem)
    if not candidates:
        return CheapestResult(None, math.inf, math.inf, 0, None, time.monotonic() - start)
    work = _Work(problem, candidates, recall)
    proven = work.run()
    rig, closest = (n if n is None else work.rig(n) for n in (work.best, work.closest))
    counts = {
        "candidates": len(candidates),
        "objects": sum(block.alone.shape[1] for block in work.blocks),
        "rounds": work.rounds,
        "rows": len(work.programme.rows),
        "cuts": len(work.programme.cuts),
        "judged": len(work.checks),
    }
    seconds = time.monotonic() - start
    value = None if work.best is None else work.values.get(work.best)
    return CheapestResult(rig, *proven, closest, seconds, value, counts)


@dataclass(eq=False)
class _Work:
    """The rounds. `chosen` are numbers of candidates throughout."""

    problem: SearchProblem
    candidates: Sequence[Rig]
    recall: Recall | None
    best: tuple[int, ...] | None = None
    closest: tuple[int, ...] | None = None
    bound: float = -math.inf
    rounds: int = 0
    checks: dict[tuple[int, ...], RigCheck] = field(default_factory=dict)
    values: dict[tuple[int, ...], float] = field(default_factory=dict)
    row_keys: set[tuple[object, ...]] = field(default_factory=set)

    def __post_init__(self) -> None:
        problem, by = self.problem, self.problem.file.search.cheapest.by
        lidars = [lidar for rig in self.candidates for lidar in rig]
        sizes = np.array([len(rig) for rig in self.candidates])
        self.owner = np.repeat(np.arange(len(sizes)), sizes)
        spots = np.array([lidar.mount.position for lidar in lidars])
        self.place = np.unique(spots, axis=0, return_inverse=True)[1].ravel()
        self.blocks = blocks_of(lidars, problem.criteria)
        limits, least = limits_of(self.candidates, problem)
        assert limits.compatible is not None
        self.compatible, self.completes = limits.compatible, limits.completes
        fixed = problem.space.fixed
        base = problem.criteria.carrier.further_totals[by] if by in TOTALS else 0.0
        self.programme = Programme(
            np.array([cost_of(rig, problem) - base for rig in self.candidates]),
            sizes.astype(float),
            limits.used,
            least,
            limits.budgets,
            np.array([rig == fixed for rig in self.candidates]),
            of_highest=by == "height",
            base=base,
        )
        self.deadline = time.monotonic() + problem.file.search.cheapest.seconds
        self.most_lidars = int(problem.space.numbers[-1]) + len(fixed)

    @property
    def cost(self) -> float:
        """Cost of the best rig so far."""
        return math.inf if self.best is None else self.programme.cost(self.best)

    @property
    def left(self) -> float:
        """Seconds left."""
        return self.deadline - time.monotonic()

    def rig(self, chosen: Iterable[int]) -> Rig:
        return ordered(lidar for i in chosen for lidar in self.candidates[i])

    def lidars(self, chosen: Sequence[int]) -> list[int]:
        """Return the numbers of the LiDARs of candidates."""
        return np.flatnonzero(np.isin(self.owner, list(chosen))).tolist()

    def run(self) -> tuple[float, float, float]:
        """Return cost and bound of the cheapest rig, then the fewest LiDARs at that cost.

        See `CheapestResult`."""
        self.add_rows(())
        if not self.greedy(by_cost=True):
            self.greedy(by_cost=False)
        self.minimise()
        cost, bound = self.cost, self.bound
        if self.best is None or not reaches(bound, cost):
            return cost, bound, 0.0
        if self.problem.file.search.cheapest.by != "lidars":
            self.programme, self.bound = self.programme.of_number(cost), 0.0
            self.minimise()
        return cost, bound, self.bound

    def minimise(self) -> None:
        """Solve, check, add rows, until a rig is as cheap as the programme, or time is up."""
        while self.left > 0 and not reaches(self.bound, self.cost):
            self.rounds += 1
            solution = self.programme.solve(self.left)
            self.bound = max(self.bound, solution.bound)
            if reaches(self.bound, self.cost) or solution.chosen is None:
                break
            if self.add_rows(solution.chosen, solution.failing):
                continue
            if self.accept(solution.chosen):
                self.programme.exactly = True
            else:
                self.try_others(self.programme.cost(solution.chosen))
        self.bound = min(self.bound, self.cost)

    def greedy(self, by_cost: bool) -> bool:
        """Find a rig to begin with: one candidate after the other, the one that adds most.

        `by_cost`: for its cost. Returns whether the rig passes the exact check. Of an object a
        LiDAR counts up to the need, and as many as may be dead and one more."""
        programme, chosen = self.programme, np.flatnonzero(self.programme.fixed).tolist()
        parts = [np.minimum(block.alone, 1.0) for block in self.blocks]
        may = ~programme.fixed & self.compatible[chosen].all(axis=0)
        while self.left > 0:
            used = programme.used[:, chosen].sum(axis=1)
            may &= (programme.used + used[:, None] <= programme.most[:, None] + 1e-9).all(axis=0)
            gains = np.zeros(len(self.owner))
            for block, part in zip(self.blocks, parts, strict=True):
                has, most = part[self.lidars(chosen)].sum(axis=0), 1.0 + block.dead
                gains += (np.minimum(has + part, most) - np.minimum(has, most)).mean(axis=1)
            worth = np.where(may, self.by_candidate(gains), -1.0)
            if by_cost and not programme.of_highest:
                worth /= np.maximum(programme.costs, 1e-9)
            if worth.max(initial=-1.0) < 0:
                break
            best = int(worth.argmax())
            may[best] = False
            if not self.completes((*chosen, best)):
                continue
            chosen.append(best)
            may &= self.compatible[best]
            if not self.add_rows(chosen) and self.accept(chosen):
                self.drop(chosen)
                return True
        return bool(chosen) and self.accept(chosen)

    def drop(self, chosen: list[int]) -> None:
        """Leave out candidates that are not needed, the dearest first."""
        for i in sorted(chosen, key=lambda i: -self.programme.costs[i]):
            rest = [j for j in chosen if j != i]
            needed = self.programme.fixed[i] or not rest or self.add_rows(rest)
            if not needed and self.accept(rest):
                chosen = rest

    def try_others(self, cost: float) -> None:
        """Check rigs that cost no more, with the most to spare."""
        for _ in range(_AT_ONCE):
            solution = self.programme.solve(min(_SPARE_SECONDS, self.left), cost, reach=1.0)
            if solution.chosen is None or self.left <= 0:
                return
            if not self.add_rows(solution.chosen, solution.failing):
                self.accept(solution.chosen)
                return

    # Rows that a choice breaks.

    def add_rows(self, chosen: Sequence[int], failing: Collection[Position] = frozenset()) -> bool:
        """Add rows that a choice breaks, LiDARs one by one; return whether there are any.

        `failing`: positions that are given up."""
        broken = self.add_cliques(chosen)
        lidars = self.lidars(chosen)
        for block in self.blocks:
            dead = itertools.combinations(lidars, min(block.dead, len(lidars)))
            for lost in [(), *filter(None, dead)]:
                remaining = [lidar for lidar in lidars if lidar not in lost]
                shares = block.of(remaining)
                short = block.short(shares, 1.0 - TOLERANCE)
                if not len(short):
                    continue
                broken = True
                rows = self.worst(block, short, shares[short])
                if not self.add_short(block, rows, remaining, lost, failing):
                    self.add_cover(block, remaining, lost)
                if not lost:
                    break  # without any of them it has less still
        return broken

    def add_cliques(self, chosen: Sequence[int]) -> bool:
        """Allow one of several candidates that are too near to each other."""
        near = [(i, j) for i, j in itertools.combinations(chosen, 2) if not self.compatible[i, j]]
        for i, j in near:
            clique, may = [i, j], ~self.compatible[i] & ~self.compatible[j]
            while may.any():
                clique.append(int(may.argmax()))
                may &= ~self.compatible[clique[-1]]
                may[clique] = False
            self.programme.cut(self.marked(clique), -math.inf, 1.0)
        return bool(near)

    def add_short(
        self,
        block: Block,
        rows: Sequence[int],
        remaining: Sequence[int],
        lost: Sequence[int],
        failing: Collection[Position],
    ) -> bool:
        """Add rows of objects of which remaining LiDARs have too little; return whether any is new.

        They hold without any LiDAR at the places of those that are lost: there is one at most."""
        added, gone = False, np.isin(self.place, self.place[list(lost)])
        whole = (block.key, *np.unique(self.place[list(lost)]).tolist())
        for row in rows:
            position = _position(block, row, whole)
            key = (whole, row, *([] if block.missed is None else remaining))
            if position in failing or key in self.row_keys:
                continue
            self.row_keys.add(key)
            base, gains = block.gains(row, remaining)
            gains = self.by_candidate(np.where(gone, 0.0, gains))
            self.programme.rows.append(Row(gains, base, position))
            added = True
            if block.dead and (block.key, row) not in self.row_keys:
                self.row_keys.add((block.key, row))
                self.add_lifted(block, row)
        return added

    def add_lifted(self, block: Block, row: int) -> None:
        """Add a row: several LiDARs have a part of the need, as any may be dead.

        Where positions may fail, those without such several fail with one of the LiDARs, each of
        which may cost some."""
        if block.may_fail and block.dead > 1:
            return
        parts = block.sensors or self.most_lidars - block.dead
        enough = block.alone[:, row] * parts >= 1.0 - TOLERANCE
        gains = self.by_candidate(enough / (block.dead + max(block.sensors, 1.0)))
        position = _position(block, row, (block.key, "lifted"), of_each=block.dead == 1)
        self.programme.rows.append(Row(gains, 0.0, position))

    def worst(self, block: Block, rows: NDArray[np.intp], shares: NDArray[np.float64]) -> list[int]:
        """Return objects with the least, of equal ones those seen least; one a position."""
        ease = np.minimum(block.alone[:, rows], 1.0).sum(axis=0)
        order = np.lexsort((ease, shares))
        first = np.unique(block.position[rows][order], return_index=True)[1]
        rows = rows[order[np.sort(first)]]
        exceeds = np.cumsum(block.areas[block.position[rows]]) > block.may_fail + TOLERANCE
        return [int(row) for row in rows[: _AT_ONCE + int(exceeds.argmax())]]

    def add_cover(self, block: Block, remaining: Sequence[int], lost: tuple[int, ...]) -> None:
        """Require a candidate that is not among as many as can be had without enough."""
        state = block.plus(block.nothing(), remaining)
        inside = set(self.owner[[*remaining, *lost]].tolist())
        alike = self.owner[np.isin(self.place, self.place[list(lost)])]
        inside |= {i for i in alike.tolist() if len(self.candidates[i]) == 1}
        ease = self.by_candidate(np.minimum(block.alone, 1.0).sum(axis=1))
        for i in np.argsort(ease).tolist():
            more = block.plus(state, () if i in inside else self.lidars((i,)))
            if len(block.short(block.shares(more), 1.0 - TOLERANCE)):
                state = more
                inside.add(i)
        self.programme.cut(1.0 - self.marked(list(inside)), 1.0)

    def by_candidate(self, of_lidars: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return sums over the LiDARs of each candidate."""
        return np.asarray(np.bincount(self.owner, of_lidars, len(self.candidates)), np.float64)

    def marked(self, chosen: Sequence[int]) -> NDArray[np.float64]:
        """Return 1 for these candidates, 0 for others."""
        marks = np.zeros(len(self.candidates))
        marks[list(chosen)] = 1.0
        return marks

    # Exact checks.

    def accept(self, choice: Sequence[int]) -> bool:
        """Check a choice exactly; add rows that exclude it if it fails."""
        chosen, programme = tuple(sorted(choice)), self.programme
        if chosen not in self.checks:
            self.checks[chosen] = check_rig(self.rig(chosen), self.problem)
            self.closest = min(
                self.checks, key=lambda c: (len(self.checks[c].broken), -self.checks[c].margin)
            )
        broken = self.checks[chosen].broken
        if (programme.used[:, list(chosen)].sum(axis=1) < programme.least - 1e-9).any():
            return False  # greedy choice alone tries rigs of too few LiDARs
        if not broken and self.finds_enough(chosen):
            self.best = chosen if programme.cost(chosen) < self.cost else self.best
            return True
        if not broken or not chosen:
            self.exclude(chosen)
        for constraint in broken if chosen else ():
            self.exclude_broken(chosen, constraint)
        return False

    def finds_enough(self, chosen: tuple[int, ...]) -> bool:
        """Return whether the detector's recall reaches its limit."""
        least = self.problem.file.search.cheapest.recall
        if self.recall is None or least is None:
            return True
        if chosen not in self.values:
            self.values[chosen] = self.recall(self.rig(chosen))
        return self.values[chosen] >= least

    def exclude(self, chosen: Sequence[int], unless: Sequence[int] | None = None) -> None:
        """Exclude rigs with all of these but those with one of `unless` (default: all others)."""
        others = 1.0 - self.marked(chosen) if unless is None else self.marked(unless)
        self.programme.cut(others - self.marked(chosen), 1.0 - len(chosen))

    def exclude_broken(self, chosen: tuple[int, ...], broken: Constraint) -> None:
        """Exclude rigs that break a constraint as this one does."""
        if broken.name in _GROWING:
            held = list(chosen)
            for i in chosen:
                rest = [j for j in held if j != i]
                if rest and broken in check_rig(self.rig(rest), self.problem).broken:
                    held = rest
            self.exclude(held, [])
            return
        outcomes = {requirement_name(o.requirement.name): o for o in self.checks[chosen].outcomes}
        outcome = outcomes.get(broken.name)
        blocks = [block for block in self.blocks if block.name == broken.name]
        # Only exact checks know these, or they depend on the order of LiDARs.
        wanted = outcome.requirement if outcome and blocks else None
        if outcome is None or wanted is None or not wanted.placed or wanted.also_when.mounts_off:
            self.exclude(chosen)
            return
        short = outcome.least_of < wanted.least
        if outcome.worst.undecided or outcome.worst.refined:  # others may be refined elsewhere
            self.exclude(chosen)
            return
        if not blocks[0].may_fail:  # one place is enough
            short = np.arange(len(short)) == outcome.least_of.argmin()
        helps = [(block.alone[:, short[block.position]] > 0).any(axis=1) for block in blocks]
        helping = np.unique(self.owner[np.any(helps, axis=0)])
        self.exclude(chosen, [i for i in helping.tolist() if i not in chosen])


def _position(
    block: Block, row: int, of: tuple[object, ...], of_each: bool = False
) -> Position | None:
    """Return the position of an object in a case of a requirement; None if none may fail."""
    number, fails = int(block.position[row]), block.may_fail
    return Position(of, number, float(block.areas[number]), fails, of_each) if fails else None

"""Finer than the grid: one LiDAR after the other moves to the best place around its own."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, replace

import numpy as np

from sweeps.search.greedy.candidates import worth_of
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.choice import Choices, is_possible, ordered, rounded
from sweeps.search.problem.constraints import Constraint, measures_of, requirement_name
from sweeps.search.problem.problem import Problem
from sweeps.search.problem.space import Placed, fits, rig_of

_MOST_ROUNDS = 4
"""Rounds over all LiDARs at one step; few improve anything."""


def refine(
    problem: Problem, traffic: Traffic, placed: Sequence[Placed]
) -> tuple[list[Placed], float]:
    """Move LiDARs one by one, each to the best of its neighbours by half a step, while that helps;
    then by a quarter, and so on. The value never falls, and all constraints stay kept if they were.
    Returns the LiDARs at this local optimum, and the value as the search computes it."""
    settings = problem.file.search.greedy
    assert settings is not None
    placed, value = list(placed), -math.inf
    for level in range(1, settings.refine + 1):
        length, angle = settings.position_step, math.radians(settings.angle_step_deg)
        step = length / 2**level, angle / 2**level
        for _ in range(_MOST_ROUNDS):
            before = value
            for i in range(len(placed)):
                placed[i], value = _moved(problem, traffic, placed, i, step)
            if value <= before:
                break
    return placed, value


def _moved(
    problem: Problem, traffic: Traffic, placed: Sequence[Placed], i: int, step: tuple[float, float]
) -> tuple[Placed, float]:
    """The best neighbour of one, which may be itself, and the value of the whole rig with it."""
    others = rig_of([*placed[:i], *placed[i + 1 :]], problem.space)
    around = neighbours(placed[i], *step)
    judged, quick = partitioned(problem.question.constraints)
    near = [placed[i], *(p for p in around if keeps(problem, ordered([*others, *p.rig]), quick))]
    rigs = [place.rig for place in near] + ([others] if others else [])
    worth = worth_of(rigs, problem, traffic)
    rest = (len(near),) if others else ()
    best_first = np.argsort(-worth.gains(rest)[: len(near)], kind="stable").tolist()
    # Requirements take longest: few neighbours are judged before one keeps them, as the start does.
    wholes = (ordered([*others, *near[k].rig]) for k in best_first)
    pairs = zip(best_first, wholes, strict=True)
    best = next(k for k, whole in pairs if k == 0 or keeps(problem, whole, judged))
    return near[best], worth.value([best, *rest])


def partitioned(constraints: Sequence[Constraint]) -> tuple[list[Constraint], list[Constraint]]:
    """Those that are requirements, and the others."""
    judged = [c for c in constraints if c.name.startswith(requirement_name(""))]
    return judged, [c for c in constraints if c not in judged]


def keeps(problem: Problem, rig: Choices, constraints: Sequence[Constraint]) -> bool:
    """Whether the rig can be, and keeps the constraints."""
    if not is_possible(rig):
        return False
    found = measures_of(rig, constraints, problem.question.carrier)
    return all(c.violation(found[c.name]) <= 0 for c in constraints)


def neighbours(place: Placed, length: float, angle: float, most: int = 6) -> Iterator[Placed]:
    """Those a step away in any combination of at most so many coordinates, without itself."""
    centre, zone = astuple(place.lidar.mount), place.slot.zone(place.lidar.zone)
    spans = place.slot.spans.values()
    steps = [length] * 3 + [angle if low < high else 0.0 for low, high in spans]
    ways = [(-step, 0.0, step) if step else (0.0,) for step in steps]
    for offset in itertools.product(*ways):
        mount = rounded(*(c + o for c, o in zip(centre, offset, strict=True)))
        if 0 < np.count_nonzero(offset) <= most and fits(place.slot, zone, mount):
            yield Placed(place.slot, replace(place.lidar, mount=mount))

"""Refinement between the candidates: LiDARs move one by one to the best place nearby."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, replace

import numpy as np

from sweeps.search.greedy.candidates import set_function_of
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.constraints import Constraint, measures_of, requirement_name
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig, is_possible, ordered, rounded
from sweeps.search.problem.slots import Assignment
from sweeps.search.problem.space import fits, rig_of

_MOST_ROUNDS = 4
"""Rounds over all LiDARs at one step; few improve anything."""


def refine(
    problem: SearchProblem, traffic: Traffic, placed: Sequence[Assignment]
) -> tuple[list[Assignment], float]:
    """Move LiDARs one by one, each to the best of its neighbours, while that helps.

    Steps are half of the grid's, then a quarter, and so on. The value never falls, and all
    constraints stay kept if they were. Returns the LiDARs at this local optimum, and the value as
    the search computes it."""
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
    problem: SearchProblem,
    traffic: Traffic,
    placed: Sequence[Assignment],
    i: int,
    step: tuple[float, float],
) -> tuple[Assignment, float]:
    """Return the best neighbour of a LiDAR, or itself, and the value of the whole rig with it."""
    others = rig_of([*placed[:i], *placed[i + 1 :]], problem.space)
    around = neighbours(placed[i], *step)
    of_requirements, quick = partitioned(problem.criteria.constraints)
    feasible = (p for p in around if is_feasible(problem, ordered([*others, *p.rig]), quick))
    near = [placed[i], *feasible]
    rigs = [place.rig for place in near] + ([others] if others else [])
    worth = set_function_of(rigs, problem, traffic)
    rest = (len(near),) if others else ()
    best_first = np.argsort(-worth.gains(rest)[: len(near)], kind="stable").tolist()
    # Requirements take longest: few neighbours are checked before one keeps them.
    wholes = (ordered([*others, *near[k].rig]) for k in best_first)
    pairs = zip(best_first, wholes, strict=True)
    best = next(k for k, whole in pairs if k == 0 or is_feasible(problem, whole, of_requirements))
    return near[best], worth.value([best, *rest])


def partitioned(constraints: Sequence[Constraint]) -> tuple[list[Constraint], list[Constraint]]:
    """Return the constraints that are requirements, and the others."""
    of_requirements = [c for c in constraints if c.name.startswith(requirement_name(""))]
    return of_requirements, [c for c in constraints if c not in of_requirements]


def is_feasible(problem: SearchProblem, rig: Rig, constraints: Sequence[Constraint]) -> bool:
    """Return whether the rig is possible and keeps the constraints."""
    if not is_possible(rig):
        return False
    measures = measures_of(rig, constraints, problem.criteria.carrier)
    return all(c.violation(measures[c.name]) <= 0 for c in constraints)


def neighbours(
    place: Assignment, length: float, angle: float, most: int = 6
) -> Iterator[Assignment]:
    """Yield neighbours a step away in any combination of at most `most` coordinates."""
    centre, zone = astuple(place.lidar.mount), place.slot.zone(place.lidar.zone)
    spans = place.slot.spans[place.lidar.model].values()
    steps = [length] * 3 + [angle if low < high else 0.0 for low, high in spans]
    ways = [(-step, 0.0, step) if step else (0.0,) for step in steps]
    for offset in itertools.product(*ways):
        mount = rounded(*(c + o for c, o in zip(centre, offset, strict=True)))
        if 0 < np.count_nonzero(offset) <= most and fits(
            place.slot, zone, mount, place.lidar.model
        ):
            yield Assignment(place.slot, replace(place.lidar, mount=mount))

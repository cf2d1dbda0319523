"""Exact checks of rigs, with LiDARs that hide each other, and what rigs cost."""

import math
from dataclasses import dataclass

from lidarplace.requirements.check_requirements import RequirementResult
from sweeps.search.problem.constraints import Constraint, measures_of, requirement_name
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig, is_possible


@dataclass(frozen=True)
class RigCheck:
    """Constraints that a rig breaks, and the results of its requirements.

    `margin`: the least ratio of found to needed over the requirements; infinite without any."""

    broken: tuple[Constraint, ...]
    outcomes: tuple[RequirementResult, ...]
    margin: float


def check_rig(rig: Rig, problem: SearchProblem) -> RigCheck:
    """Check all constraints of a rig."""
    criteria, carrier = problem.criteria, problem.criteria.carrier
    if not is_possible(rig):
        return RigCheck(criteria.constraints, (), 0.0)
    outcomes = carrier.requirement_results(rig)
    values = {requirement_name(result.requirement.name): result.worst.value for result in outcomes}
    others = [c for c in criteria.constraints if c.name not in values]
    values |= measures_of(rig, others, carrier)
    broken = tuple(c for c in criteria.constraints if c.violation(values[c.name]) > 0)
    margins = (result.worst.value / result.requirement.least for result in outcomes)
    return RigCheck(broken, tuple(outcomes), min(margins, default=math.inf))


def cost_of(rig: Rig, problem: SearchProblem) -> float:
    """Return the cost of a rig: LiDARs, price, watts, or height of the highest mount, metres."""
    by = problem.file.search.cheapest.by
    if by == "lidars":
        return float(len(rig))
    if by == "height":
        return max(lidar.mount.z for lidar in rig)
    return problem.criteria.carrier.total_of(by, rig)

"""Improvements off the grid: LiDARs move a little, are left out or become cheaper."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

from sweeps.search.cheapest.cheapest_rig import Recall
from sweeps.search.cheapest.rig_check import RigCheck, check_rig, cost_of
from sweeps.search.greedy.certificate import slots_of
from sweeps.search.greedy.refine import neighbours
from sweeps.search.problem.constraints import requirement_name
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import MountedLidar, Rig
from sweeps.search.problem.slots import Assignment
from sweeps.search.problem.space import broken_count, rig_of
from tracking.labels import digits

_HOPELESS = 0.5
"""Least margin of a rig that is moved to see whether it can meet everything."""
_PLENTY = 2.0
"""Margin above which more is no better."""


def polish(problem: SearchProblem, rig: Rig, recall: Recall | None) -> Rig:
    """Return a rig that meets everything, is not dearer than this one and has more to spare.

    Cheaper rigs are tried first: without one of its LiDARs, or with a cheaper model in its place.
    Each coordinate of each LiDAR moves by half a step of the grid while that helps, then by a
    quarter, and so on, as `search.greedy.refine` says. Then surplus LiDARs are left out. It takes
    no longer than the choice may."""
    settings, least = problem.file.search.greedy, problem.file.search.cheapest.recall
    assert settings is not None
    until = time.monotonic() + problem.file.search.cheapest.seconds

    def meets_all(rig: Rig) -> bool:
        if check_rig(rig, problem).broken:
            return False
        return recall is None or least is None or recall(rig) >= least

    def meets_all_in_time(rig: Rig) -> bool:
        return time.monotonic() < until and meets_all(rig)

    best, starts = rig, sorted(_cheaper(problem, rig), key=lambda start: _order(problem, start))
    for start in [*starts, rig]:
        if _order(problem, start) > _order(problem, best):
            continue
        placed = slots_of(start, problem)
        if placed is None or _value(problem, placed)[0] < _HOPELESS:
            continue
        for level in range(1, settings.refine + 1):
            length, angle = settings.position_step, math.radians(settings.angle_step_deg)
            placed = _moved(problem, placed, length / 2**level, angle / 2**level, until)
        moved = rig_of(placed, problem.space)
        if meets_all(moved):
            best = moved
    while cheaper := next(filter(meets_all_in_time, _cheaper(problem, best)), None):
        best = cheaper
    return best


def _order(problem: SearchProblem, rig: Rig) -> tuple[float, int]:
    """Return the objective to minimise: the cost, then the number of LiDARs."""
    return cost_of(rig, problem), len(rig)


def _cheaper(problem: SearchProblem, rig: Rig) -> Iterator[Rig]:
    """Yield rigs without one of the LiDARs, or mirrored pairs, and with a cheaper model."""
    placed = slots_of(rig, problem) or []
    for i, place in enumerate(placed):
        models = (replace(place.lidar, model=model) for model in place.slot.models)
        for left in [[], *([replace(place, lidar=lidar)] for lidar in models)]:
            new = rig_of([*placed[:i], *placed[i + 1 :], *left], problem.space)
            is_cheaper = bool(new) and _order(problem, new) < _order(problem, rig)
            if is_cheaper and slots_of(new, problem) is not None:
                yield new


def _moved(
    problem: SearchProblem, placed: Sequence[Assignment], length: float, angle: float, until: float
) -> list[Assignment]:
    """Move one coordinate by a step, as long as one helps."""
    placed, value, better = list(placed), _value(problem, placed), True
    while better and time.monotonic() < until:
        better = False
        for i in range(len(placed)):
            for place in neighbours(placed[i], length, angle, most=1):
                new = [*placed[:i], place, *placed[i + 1 :]]
                if time.monotonic() < until and (new_value := _value(problem, new)) > value:
                    placed, value, better = new, new_value, True
    return placed


def _value(problem: SearchProblem, placed: Sequence[Assignment]) -> tuple[float, float, float]:
    """Return a key to maximise: requirements met, then low cost, then margin."""
    rig = rig_of(placed, problem.space)
    rig_check = check_rig(rig, problem)
    if any(not c.name.startswith(requirement_name("")) for c in rig_check.broken):
        return -1.0, 0.0, 0.0
    return min(rig_check.margin, 1.0), -cost_of(rig, problem), min(rig_check.margin, _PLENTY)


def needed_for(problem: SearchProblem, rig: Rig, recall: Recall | None) -> list[str]:
    """Name the first failure without each LiDAR, or without it and its mirror image.

    It is a requirement, a constraint, the recall, or the setting that asks for the LiDAR. Where
    nothing fails, it says why the LiDAR is there all the same."""
    return [_needed_for(problem, rig, lidar, recall) for lidar in rig]


def _needed_for(
    problem: SearchProblem, rig: Rig, lidar: MountedLidar, recall: Recall | None
) -> str:
    search, placed = problem.file.search, slots_of(rig, problem) or ()
    together = next((place.rig for place in placed if lidar in place.rig), ())
    removals: dict[Rig, str] = {(lidar,): ""}
    if len(together) > 1:
        (partner,) = (rig.index(other) + 1 for other in together if other != lidar)
        removals[together] = f"without LiDAR {partner}, its mirror image, too: "
    for parts, text in removals.items():
        rest = tuple(other for other in rig if other not in parts)
        if (rig_check := check_rig(rest, problem)).broken:
            return text + _worst(rig_check)
    if not together:
        return "search.fixed"
    if broken := broken_count(problem.space, rest):
        return f"search.{broken[0].key}"
    least = search.cheapest.recall
    if recall is not None and least is not None and (recall_value := recall(rest)) < least:
        return f"{search.objective[0].name} {recall_value:.1f}"
    if cost_of(rest, problem) >= cost_of(rig, problem):
        return f"nothing: the {search.cheapest.by} is the same without it"
    return "nothing: search.cheapest.seconds were over before it was left out"


def _worst(rig_check: RigCheck) -> str:
    """Name the requirement that lacks most, and where; or another constraint."""
    short = [result for result in rig_check.outcomes if not result.met]
    if not short:
        return rig_check.broken[-1].name.removeprefix(requirement_name(""))
    result = min(short, key=lambda result: result.worst.value / result.requirement.least)
    x, y = digits(result.worst.x, "z.2f"), digits(result.worst.y, "z.2f")
    return f"{result.requirement.name} at x {x}, y {y}"

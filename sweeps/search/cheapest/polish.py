"""Off the grid: LiDARs move a little, are left out or become cheaper, while everything is met."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

from sweeps.search.cheapest.choose import Recall, Verdict, cost_of, verdict_of
from sweeps.search.greedy.certificate import slots_of
from sweeps.search.greedy.refine import neighbours
from sweeps.search.problem.choice import Choice, Choices
from sweeps.search.problem.constraints import requirement_name
from sweeps.search.problem.problem import Problem
from sweeps.search.problem.space import Placed, rig_of
from tracking.labels import digits

_HOPELESS = 0.5
"""A rig with a smaller margin than that is not moved to see whether it can meet all."""
_PLENTY = 2.0
"""Of what is needed; more is no better."""


def polish(problem: Problem, rig: Choices, recall: Recall | None) -> Choices:
    """A rig that meets everything, is not dearer than this one and has more to spare.

    Cheaper rigs are tried first: without one of its LiDARs, or with a cheaper model in its place.
    Each coordinate of each LiDAR moves by half a step of the grid while that helps, then by a
    quarter, and so on, as `search.greedy.refine` says. It takes no longer than the choice may.
    Then what became surplus is left out.
    """
    settings, least = problem.file.search.greedy, problem.file.search.cheapest.recall
    assert settings is not None
    until = time.monotonic() + problem.file.search.cheapest.seconds

    def meets_all(rig: Choices) -> bool:
        if verdict_of(rig, problem).broken:
            return False
        return recall is None or least is None or recall(rig) >= least

    best, starts = rig, sorted(_cheaper(problem, rig), key=lambda own: _order(problem, own))
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
    while cheaper := next(filter(meets_all, _cheaper(problem, best)), None):
        best = cheaper
    return best


def _order(problem: Problem, rig: Choices) -> tuple[float, int]:
    """Return the objective to minimise: the cost, then the number of LiDARs."""
    return cost_of(rig, problem), len(rig)


def _cheaper(problem: Problem, rig: Choices) -> Iterator[Choices]:
    """The rig without one of its LiDARs, or mirrored pairs, and with a cheaper model."""
    placed = slots_of(rig, problem) or []
    for i, place in enumerate(placed):
        models = (replace(place.lidar, model=model) for model in place.slot.models)
        for own in [[], *([replace(place, lidar=lidar)] for lidar in models)]:
            new = rig_of([*placed[:i], *placed[i + 1 :], *own], problem.space)
            is_cheaper = bool(new) and _order(problem, new) < _order(problem, rig)
            if is_cheaper and slots_of(new, problem) is not None:
                yield new


def _moved(
    problem: Problem, placed: Sequence[Placed], length: float, angle: float, until: float
) -> list[Placed]:
    """Moves of one coordinate by a step, as long as one helps."""
    placed, value, better = list(placed), _value(problem, placed), True
    while better and time.monotonic() < until:
        better = False
        for i in range(len(placed)):
            for place in neighbours(placed[i], length, angle, most=1):
                new = [*placed[:i], place, *placed[i + 1 :]]
                if time.monotonic() < until and (own := _value(problem, new)) > value:
                    placed, value, better = new, own, True
    return placed


def _value(problem: Problem, placed: Sequence[Placed]) -> tuple[float, float, float]:
    """First requirements are met, then it is cheap, then there is something to spare."""
    rig = rig_of(placed, problem.space)
    verdict = verdict_of(rig, problem)
    if any(not own.name.startswith(requirement_name("")) for own in verdict.broken):
        return -1.0, 0.0, 0.0
    return min(verdict.margin, 1.0), -cost_of(rig, problem), min(verdict.margin, _PLENTY)


def needed_for(problem: Problem, rig: Choices, recall: Recall | None) -> list[str]:
    """Name the first failure without each LiDAR, or without its mirrored pair: a requirement, a
    constraint, the recall, or the setting that asks for it; "" for nothing."""
    placed = slots_of(rig, problem) or []
    return [_needed_for(problem, rig, lidar, placed, recall) for lidar in rig]


def _needed_for(
    problem: Problem, rig: Choices, lidar: Choice, placed: Sequence[Placed], recall: Recall | None
) -> str:
    search = problem.file.search
    together = next((place.rig for place in placed if lidar in place.rig), ())
    removals = {(lidar,): ""} | ({together: "the pair: "} if len(together) > 1 else {})
    for parts, text in removals.items():
        rest = tuple(other for other in rig if other not in parts)
        if (verdict := verdict_of(rest, problem)).broken:
            return text + _worst(verdict)
    if not together:
        return "search.fixed"
    if slots_of(rest, problem) is None:
        return f"search.zones.{lidar.zone}.lidars" if search.counted else "search.lidars"
    least = search.cheapest.recall
    if recall is not None and least is not None and (found := recall(rest)) < least:
        return f"{search.objective[0].name} {found:.1f}"
    return ""


def _worst(verdict: Verdict) -> str:
    """The requirement that lacks most, and where; or another constraint."""
    short = [own for own in verdict.outcomes if not own.met]
    if not short:
        return verdict.broken[-1].name.removeprefix(requirement_name(""))
    own = min(short, key=lambda own: own.worst.value / own.requirement.least)
    x, y = digits(own.worst.x, "z.2f"), digits(own.worst.y, "z.2f")
    return f"{own.requirement.name} at x {x}, y {y}"

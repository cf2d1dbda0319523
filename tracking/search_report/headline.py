"""The first screen: what was found, against the paper's eight and against the upper bound."""

from __future__ import annotations

from dataclasses import dataclass

from tracking.report.tables import number
from tracking.search_folder import SearchFolder
from tracking.search_report.feasibility import infeasible_sentences
from tracking.search_result import Objective, Rig, SearchResult


@dataclass(frozen=True)
class Card:
    """A statement with what is to be known about it."""

    title: str
    value: str
    lines: tuple[str, ...]


def summary(search: SearchResult) -> str:
    """What was searched, in one line."""
    goals = ", ".join(f"{o.direction} {o.name}" for o in search.objectives).capitalize()
    return (
        f"{goals} · {', '.join(search.classes)} · {search.frames:,} frames · {search.sampler}, "
        f"seed {search.seed}, {search.evaluations:,} evaluations in {search.seconds:,.0f} s"
    )


def cards(run: SearchFolder) -> list[Card]:
    """What was found, and what the search did."""
    search = run.search
    first = _found(search) if search.best else _nothing_found(run)
    return [first, _effort(search)]


def change(objective: Objective, value: float, base: float) -> str:
    """How a value differs from `base`: in percent if that is positive, else in its unit."""
    if base > 0:
        shown = f"{100 * (value / base - 1):+.1f} %"
    else:
        shown = f"{value - base:+.4g} {objective.unit}".rstrip()
    return shown.replace("-", "−")


def with_unit(objective: Objective, value: float) -> str:
    """A value as text."""
    return f"{number(value)} {objective.unit}".rstrip()


def _found(search: SearchResult) -> Card:
    name = search.best[0]
    rig = search.rigs[name]
    lines = [_against_baseline(search, objective, rig) for objective in search.objectives]
    lines = [line for line in lines if line] + _against_bound(search)
    if search.constraints:
        lines.append(f"Feasible: it keeps all {len(search.constraints)} constraints.")
    else:
        lines.append("Feasible: there were no constraints.")
    models = sorted({*rig.models})
    lines.append(f"{len(rig.mounts)} LiDAR{'s' * (len(rig.mounts) > 1)}: {', '.join(models)}.")
    front = len(search.objectives) > 1
    return Card(
        f"Pareto front of {len(search.best)}, the first is {name}"
        if front
        else f"Best rig: {name}",
        f"{search.first.name} {with_unit(search.first, rig.value(search.first))}",
        tuple(lines),
    )


def _against_baseline(search: SearchResult, objective: Objective, rig: Rig) -> str:
    """The value of a further objective, and of each how it compares; "" if nothing is to say."""
    first = objective is search.first
    own = "" if first else f"{objective.name} {with_unit(objective, rig.value(objective))}"
    if not search.baseline:
        return f"{own}." if own else ""
    base = search.rigs[search.baseline].value(objective)
    compared = f"{change(objective, rig.value(objective), base)} against {search.baseline}"
    compared += ", the best of the paper's eight" if first else ""
    compared += f" ({with_unit(objective, base)})."
    return f"{own}, {compared}" if own else compared


def _nothing_found(run: SearchFolder) -> Card:
    return Card("Result", "No feasible rig", tuple(infeasible_sentences(run)))


def _against_bound(search: SearchResult) -> list[str]:
    bound = search.bound
    if bound is None:
        return []
    if bound.value is None:
        return [f"No upper bound: {bound.reason}"] if bound.reason else []
    among = f"of {bound.candidates:,} candidate mounts" if bound.candidates else "of the candidates"
    best = bound.best_value
    limit = with_unit(search.first, bound.value)
    if best is not None and best > bound.value:
        return [f"Above the upper bound of any rig {among}, {limit}: it sits between them."]
    if bound.gap_percent is None:
        return [f"Upper bound of any rig {among}: {limit}."]
    return [
        f"At most {bound.gap_percent:.1f} % below the best possible {among} (upper bound {limit})."
    ]


def _effort(search: SearchResult) -> Card:
    busy = search.sampler_seconds + search.evaluation_seconds
    lines = [
        f"{search.feasible:,} of {search.trials:,} trials are feasible.",
        f"{search.repeated:,} repeated a rig and were not evaluated again.",
        f"Sampler {search.sampler_seconds:,.1f} s, evaluations {search.evaluation_seconds:,.1f} s"
        + (
            f": the sampler's share is {100 * search.sampler_seconds / busy:.0f} %."
            if busy
            else "."
        ),
        f"Batches of {search.batch_size}.",
    ]
    stride = search.stride
    if stride is not None and stride.azimuth_stride > 1:
        error = (
            ""
            if stride.relative_error is None
            else f", relative error {100 * stride.relative_error:.2g} %"
        )
        lines.append(f"1 of {stride.azimuth_stride} azimuth steps was fired, with weight{error}.")
    return Card("The search", f"{search.evaluations:,} evaluations", tuple(lines))

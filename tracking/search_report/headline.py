"""The first screen: what was found, against the paper's eight and the bound, and what is next."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tracking.findings.evidence import Weakness, few_seeds, grade, remedy, value_at
from tracking.labels import digits, not_significant, number, span
from tracking.run_folders.search import SearchFolder
from tracking.run_folders.search_json import Command, Objective, Rig, SearchResult
from tracking.search_report.feasibility import infeasible_sentences, nothing_found


@dataclass(frozen=True)
class Card:
    """A statement with what is to be known about it."""

    title: str
    value: str
    lines: tuple[str, ...]


def summary(search: SearchResult) -> str:
    """What was searched, in one line."""
    goals = ", ".join(f"{o.direction} {o.name}" for o in search.objectives)
    goals += f", {search.over}" if search.over else ""
    frames = f"{search.frames:,} frames · " if search.frames else ""
    return (
        f"{goals[0].upper()}{goals[1:]} · {', '.join(search.classes)} · {frames}"
        f"{search.sampler}, seed {search.seed}, {search.evaluations:,} evaluations; the last "
        f"command took {search.seconds:,.0f} s"
    )


def answer(run: SearchFolder) -> Card:
    """What was found."""
    if run.search.best:
        return _found(run)
    return Card("Result", nothing_found(run), tuple(infeasible_sentences(run)))


def next_steps(run: SearchFolder) -> list[Command]:
    """What to do next; what the evidence lacks comes first."""
    few = _few_seeds(run)
    if not few or "pretrained" in run.search.first.name.split("."):  # of which there is one
        return [*run.search.commands]
    more = Command(
        what="too little is known to choose a rig: judge with more generalists",
        line=remedy(run.search.command, few),
    )
    return [more, *run.search.commands]


def change(objective: Objective, value: float, base: float) -> str:
    """How a value differs from `base`: in points of percent, in percent, or else in its unit."""
    if objective.unit == "%":
        return f"{digits(value - base, '+.1f')} points"
    if base > 0:
        return f"{digits(100 * (value / base - 1), '+.1f')} %"
    return f"{digits(value - base, '+.4g')} {objective.unit}".rstrip()


def with_unit(objective: Objective, value: float) -> str:
    """A value as text."""
    return f"{shown(objective, value)} {objective.unit}".rstrip()


def shown(objective: Objective, value: float) -> str:
    """A value without its unit, with digits that mean something: percent are of a sample."""
    return digits(value, "z.1f") if objective.unit == "%" else number(value)


def _found(run: SearchFolder) -> Card:
    search = run.search
    name = search.best[0]
    rig = search.rigs[name]
    lines = [_against_baseline(search, objective, rig) for objective in search.objectives]
    few = _few_seeds(run)
    lines = [line for line in lines if line] + _how_sure(run) + ([grade(few)] if few else [])
    lines += _models_of_peers(search)
    lines += _against_bound(search)
    if search.constraints:
        lines.append(f"Feasible: it keeps all {len(search.constraints)} constraints.")
    else:
        lines.append("Feasible: there were no constraints.")
    models = sorted({*rig.models})
    lines.append(f"{len(rig.mounts)} LiDAR{'s' * (len(rig.mounts) > 1)}: {', '.join(models)}.")
    return Card(
        f"{of_front(search)}, the first is {name}"
        if search.front
        else f"Best of the search: {name}",
        f"{search.first.name} {with_unit(search.first, rig.value(search.first))}",
        tuple(lines),
    )


def best_of_paper(search: SearchResult) -> str:
    """What the baseline is, to follow its name."""
    base = search.rigs[search.baseline] if search.baseline is not None else None
    best = search.rigs[search.best[0]] if search.best else base
    broken = "" if base is not None and base.feasible else ", which breaks a constraint"
    if base is None or best is None or len(base.mounts) == len(best.mounts):
        return f", the best of the paper's eight{broken}"
    return f", the best of the paper's eight, with {len(base.mounts)} LiDARs{broken}"


def of_front(search: SearchResult) -> str:
    """The rigs of a Pareto front, which may be too many to give them all."""
    shown, whole = len(search.best), search.front
    if whole is not None and whole > shown:
        return f"{shown:,} of {whole:,} rigs of the Pareto front"
    return f"Pareto front of {shown:,}"


def _models_of_peers(search: SearchResult) -> list[str]:
    """What the paper's rigs are made of, where LiDARs were to choose from."""
    if search.baseline is None or len(search.models) < 2:
        return []
    models = sorted({*search.rigs[search.baseline].models})
    return [f"The paper's rigs are of LiDAR {', '.join(models)}."]


def _against_baseline(search: SearchResult, objective: Objective, rig: Rig) -> str:
    """The value of a further objective, and of each how it compares; "" if nothing is to say."""
    first = objective is search.first
    own = "" if first else f"{objective.name} {with_unit(objective, rig.value(objective))}"
    if not search.baseline:
        return f"{own}." if own else ""
    base = search.rigs[search.baseline].value(objective)
    if np.isnan(base):
        unknown = f"{objective.name} of {search.baseline} is unknown."
        return f"{own}; {unknown}" if own else unknown
    compared = f"{change(objective, rig.value(objective), base)} against {search.baseline}"
    compared += f"{best_of_paper(search) if first else ''} ({with_unit(objective, base)})."
    return f"{own}, {compared}" if own else compared


def _how_sure(run: SearchFolder) -> list[str]:
    """The interval of the lead on other traffic, where a generalist judged; else nothing."""
    search = run.search
    if run.chosen is None or search.baseline is None:
        return []
    rows = of_objective(run.chosen, search.first)
    rows = rows[rows["rig"] == search.best[0]]
    over = f" ({search.chosen_over})" if search.chosen_over else ""
    return [
        f"Of {row['class']}, on traffic that the search did not see{over}: "
        f"{digits(row['difference'], '+.1f')} points (95 % CI "
        f"{span(row['difference_low'], row['difference_high'], '+.1f')})"
        f"{not_significant(row['difference_low'], row['difference_high'])}."
        for row in rows.to_dict("records")
        if not np.isnan(row["difference"])
    ]


def _few_seeds(run: SearchFolder) -> list[Weakness]:
    """Why a generalist's choice is not sufficient evidence; or []."""
    if run.chosen is None:
        return []
    seeds = value_at(run.config, "search", "seeds") or [0]
    return few_seeds({run.search.best[0]: set(seeds)}, True, "search.seeds")


def of_objective(measured: pd.DataFrame, objective: Objective) -> pd.DataFrame:
    """Rows of `chosen` or `verified` that hold what an objective is made of."""
    weighed = measured["class"].isin(objective.weights or {})
    return measured[(measured["metric"] == objective.by) & weighed]


def _against_bound(search: SearchResult) -> list[str]:
    bound = search.bound
    if bound is None or search.first.unit == "%":  # there is none of what detectors measure
        return []
    if bound.value is None:
        return [f"No upper bound: {bound.reason}"] if bound.reason else []
    among = f"of {bound.candidates:,} candidate mounts" if bound.candidates else "of the candidates"
    best = bound.best_value
    limit = with_unit(search.first, bound.value)
    if best is not None and best > bound.value:
        said = f"above the upper bound of any rig {among}, {limit}: it sits between them."
    elif bound.gap_percent is None:
        said = f"upper bound of any rig {among}: {limit}."
    else:
        said = (
            f"at most {bound.gap_percent:.1f} % below the best possible {among} "
            f"(upper bound {limit})."
        )
    rays = search.strided
    if rays:  # the bound is of such values, not of the exact one above
        value = with_unit(search.first, search.rigs[search.best[0]].searched_value(search.first))
        return [f"As searched, with {rays}: {value}, {said}"]
    return [f"{said[0].upper()}{said[1:]}"]


def effort(search: SearchResult) -> str:
    """How much was tried, and what the time went into."""
    busy = search.sampler_seconds + search.evaluation_seconds
    lines = [
        f"{search.evaluations:,} evaluations in batches of {search.batch_size}.",
        f"{search.feasible:,} of {search.trials:,} trials are feasible.",
        f"{search.repeated:,} repeated a rig and were not evaluated again.",
    ]
    if busy:
        lines.append(
            f"Time of the last command: sampler {search.sampler_seconds:,.1f} s, evaluations "
            f"{search.evaluation_seconds:,.1f} s: the sampler's share is "
            f"{100 * search.sampler_seconds / busy:.0f} %."
        )
    rays = search.strided
    if search.stride is not None and rays:
        error = search.stride.relative_error
        known = (
            ""
            if error is None
            else f": the error is at most {100 * error:.2g} % of one rig's value"
        )
        lines.append(f"It fired {rays}, with weight{known}.")
    return " ".join(lines)

"""Headline of a search: the best rig, against the paper's eight and the bound, and what is next."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tracking.findings.evidence import Weakness, few_seeds, grade, remedy, value_at
from tracking.labels import digits, not_significant, number, span
from tracking.run_folders.search import SearchFolder
from tracking.run_folders.search_json import UNNAMED, Command, Objective, Rig, SearchResult
from tracking.search_report.feasibility import infeasible_sentences, nothing_found


@dataclass(frozen=True)
class Card:
    """Statement with the lines that explain it."""

    title: str
    value: str
    lines: tuple[str, ...]


def summary(search: SearchResult) -> str:
    """Describe the search in one line."""
    goals = ", ".join(f"{o.direction} {o.name}" for o in search.objectives)
    goals += f", {search.over}" if search.over else ""
    frames = f"{search.frames:,} frames · " if search.frames else ""
    return (
        f"{goals[0].upper()}{goals[1:]} · {', '.join(search.classes)} · {frames}"
        f"{search.sampler}, seed {search.seed}, {search.evaluations:,} evaluations; the last "
        f"command took {search.seconds:,.0f} s"
    )


def answer(run: SearchFolder) -> Card:
    """State the best rig, or why there is none."""
    if run.search.best:
        return _found(run)
    return Card("Result", nothing_found(run), tuple(infeasible_sentences(run)))


def next_steps(run: SearchFolder) -> list[Command]:
    """List the next steps; what the evidence lacks comes first."""
    few = _few_seeds(run)
    if not few or "pretrained" in run.search.first.name.split("."):  # of which there is one
        return [*run.search.commands]
    step = "not enough evidence to choose a rig: evaluate with more generalists"
    return [Command(what=step, line=remedy(run.search.command, few)), *run.search.commands]


def change(objective: Objective, value: float, base: float) -> str:
    """Format how a value differs from `base`: in points, in percent, or else in its unit."""
    if objective.unit == "%":
        return f"{digits(value - base, '+.1f')} points"
    if base > 0:
        return f"{digits(100 * (value / base - 1), '+.1f')} %"
    return f"{digits(value - base, '+.4g')} {objective.unit}".rstrip()


def with_unit(objective: Objective, value: float) -> str:
    """Format a value with its unit."""
    return f"{format_value(objective, value)} {objective.unit}".rstrip()


def format_value(objective: Objective, value: float) -> str:
    """Format a value without its unit, with digits that mean something: percent are of a sample."""
    if objective.by == "margin":  # of requirements, in whose units it has no more digits
        return digits(value, "z.3g")
    if objective.by == "price":
        return digits(value, ",.6g")
    return digits(value, "z.1f") if objective.unit == "%" else number(value)


def _found(run: SearchFolder) -> Card:
    search, name = run.search, run.search.best[0]
    rig, few = search.rigs[name], _few_seeds(run)
    compared = (_against_baseline(search, objective, rig) for objective in search.objectives)
    lines = [*filter(None, compared), *_how_sure(run), *([grade(few)] if few else [])]
    of_paper = search.baseline is not None and search.rigs[search.baseline].role == "paper"
    if of_paper and len(search.models) > 1:
        lines.append("The paper's rigs have the LiDAR of the key `lidar`, not of search.models.")
    lines += _against_bound(search)
    count = len(search.constraints)
    constraints_kept = (
        f"it keeps all constraints ({count})" if count else "there were no constraints"
    )
    lines.append(f"Feasible: {constraints_kept}.")
    numbers = sorted(Counter(rig.models).items())
    models = ", ".join(f"{number} {name}" if numbers[1:] else name for name, number in numbers)
    named = "" if models == UNNAMED else f": {models}"
    lines.append(f"{len(rig.mounts)} LiDAR{'s' * (len(rig.mounts) > 1)}{named}.")
    pairs = sorted({zone.name for zone in search.zones if zone.mirrored} & {*rig.zones})
    lines += [pairs_sentence(pairs)] if pairs else []
    first = f"{of_front(search)}, the first is" if search.front else "Best of the search:"
    value = f"{search.first.name} {with_unit(search.first, rig.value(search.first))}"
    return Card(f"{first} {name}", value, tuple(lines))


def pairs_sentence(zones: Iterable[str]) -> str:
    """State that the LiDARs of zones are bought in pairs."""
    return f"LiDARs in {', '.join(zones)} are in mirrored pairs: both of a pair are bought."


def best_of_peers(search: SearchResult) -> str:
    """Describe the baseline, to follow its name."""
    base = search.rigs.get(search.baseline or "")
    if base is None:
        return ""
    best, lidars, broken = search.rigs[search.best[0]] if search.best else base, "", ""
    if len(base.mounts) != len(best.mounts):
        lidars = f", with {len(base.mounts)} LiDARs instead of {len(best.mounts)}"
    if not base.feasible:
        limits = [c for c in search.constraints if not c.is_kept(base.measures.get(c.name))]
        broken = ", infeasible"
        broken += f" by {', '.join(c.name for c in limits)}" if limits else ""
    number = sum(rig.role == base.role for rig in search.rigs.values())
    peers = "the paper's eight" if base.role == "paper" else f"{number} plain rigs"
    return f", the best of {peers}{lidars}{broken}" if number > 1 else f"{lidars}{broken}"


def of_front(search: SearchResult) -> str:
    """Describe the rigs of a Pareto front, which may be too many to give them all."""
    listed, whole = len(search.best), search.front
    if whole is not None and whole > listed:
        return f"{listed:,} of {whole:,} rigs of the Pareto front"
    return f"Pareto front of {listed:,}"


def _against_baseline(search: SearchResult, objective: Objective, rig: Rig) -> str:
    """Compare a value with the baseline's, after that of a further objective; "" without either."""
    first, value = objective is search.first, rig.value(objective)
    further_value = "" if first else f"{objective.name} {with_unit(objective, value)}"
    if not search.baseline:
        return further_value and f"{further_value}."
    base = search.rigs[search.baseline].value(objective)
    if np.isnan(base):
        unknown = f"{objective.name} of {search.baseline} is unknown."
        return f"{further_value}; {unknown}" if further_value else unknown
    compared = f"{change(objective, value, base)} against {search.baseline}"
    compared += f"{best_of_peers(search) if first else ''} ({with_unit(objective, base)})."
    return f"{further_value and f'{further_value}, '}{compared}"


def _how_sure(run: SearchFolder) -> list[str]:
    """State the interval of the lead on other traffic, where a generalist judged; else nothing."""
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
    """Report that a generalist's choice is not sufficient evidence; or []."""
    if run.chosen is None:
        return []
    seeds = value_at(run.config, "search", "seeds") or [0]
    return few_seeds({run.search.best[0]: set(seeds)}, True, "search.seeds")


def of_objective(measured: pd.DataFrame, objective: Objective) -> pd.DataFrame:
    """Select the rows of `chosen` or `verified` that hold what an objective is made of."""
    weighed = measured["class"].isin(objective.weights or {})
    return measured[(measured["metric"] == objective.by) & weighed]


def _against_bound(search: SearchResult) -> list[str]:
    bound = search.bound
    if bound is None or search.first.unit == "%":  # there is none of what detectors measure
        return []
    if bound.value is None:
        return [f"No upper bound: {bound.reason}."] if bound.reason else []
    among = f"of {bound.candidates:,} candidate mounts" if bound.candidates else "of the candidates"
    best = bound.best_value
    limit = with_unit(search.first, bound.value)
    if best is not None and best > bound.value:
        comparison = f"above the upper bound of any rig {among}, {limit}: it sits between them."
    elif bound.gap_percent is None:
        comparison = f"upper bound of any rig {among}: {limit}."
    else:
        comparison = (
            f"at most {bound.gap_percent:.1f} % below the best possible {among} "
            f"(upper bound {limit})."
        )
    rays = search.strided
    if rays:  # the bound is of such values, not of the exact one above
        value = with_unit(search.first, search.rigs[search.best[0]].searched_value(search.first))
        return [f"As searched, with {rays}: {value}, {comparison}"]
    return [f"{comparison[0].upper()}{comparison[1:]}"]


def effort(search: SearchResult) -> str:
    """Describe how much was tried, and what the time was spent on."""
    busy = search.sampler_seconds + search.evaluation_seconds
    lines = [
        f"{search.evaluations:,} evaluations in batches of {search.batch_size}.",
        f"{search.feasible:,} of {search.trials:,} trials are feasible.",
    ]
    if search.repeated:
        lines.append(f"{search.repeated:,} repeated a rig and were not evaluated again.")
    if busy:
        lines.append(
            f"Time of the last command: sampler {search.sampler_seconds:,.1f} s, evaluations "
            f"{search.evaluation_seconds:,.1f} s: the sampler's share is "
            f"{100 * search.sampler_seconds / busy:.0f} %."
        )
    if search.stride is not None and search.strided:
        error, accuracy = search.stride.relative_error, ""
        if error is not None:
            accuracy = f": the error is at most {100 * error:.2g} % of one rig's value"
        lines.append(f"It fired {search.strided}, with weight{accuracy}.")
    return " ".join(lines)

"""The best rigs of a search by a generalist, judged again on traffic that it did not see."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pandas as pd
from rich.console import Console

from sweeps.execution.backends import Backend, BackendLost
from sweeps.execution.execute import execute
from sweeps.execution.progress import StageProgress
from sweeps.plan.plan import Trial
from sweeps.results.trial_results import trial_results
from sweeps.search.judgement.found import baseline_of
from sweeps.search.judgement.verify import verified_table
from sweeps.search.judgement.winners import Judged, ranked
from sweeps.search.problem.judged_sweep import judged_plan
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.by_detectors import measured_value
from sweeps.store.of_sweep import reference
from sweeps.store.open import AnyStore

MOST_CHOSEN = 8
"""Rigs of the search among which is chosen."""


def choose(
    console: Console,
    problem: Problem,
    judged: Mapping[str, Judged],
    store: AnyStore,
    backend: Backend,
) -> tuple[dict[str, Judged], pd.DataFrame]:
    """The best rigs of the search and the paper's on the traffic of the choice.

    Returns:
        The rigs with what they are worth there, those that were found in their new order and
        names, then the others; and the table of `verified_table`.

    Raises:
        BackendLost: a rig could not be judged.
    """
    first = problem.file.search.objective[0]
    found = [name for name, own in judged.items() if own.role == "found"][:MOST_CHOSEN]
    names = [*found, *(name for name, own in judged.items() if own.role != "found")]
    # Names of the paper's placements are taken.
    aliases = {f"judged_{number}": name for number, name in enumerate(names, start=1)}
    plan = judged_plan(
        problem,
        {alias: judged[name].rig for alias, name in aliases.items()},
        problem.traffic.choice,
    )
    tasks = plan.needed_for(t.evaluate for t in plan.trials if t.evaluate is not None)
    store.refer(reference(problem.sweep(), "choice"), [task.key for task in tasks])
    with StageProgress(console, tasks, store.finished(tasks)) as progress:
        outcome = execute(tasks, store, backend, progress)
    for failure in outcome.failures.values():
        raise BackendLost(f"the best rigs could not be judged: {failure.reason}")
    by_name: dict[str, list[Trial]] = {}
    for trial in plan.trials:
        by_name.setdefault(aliases[trial.grid_point.point.placement], []).append(trial)
    measured = [o for o in problem.file.search.objective if o.measured]
    values = {
        name: {o.name: measured_value(o, trials, store) for o in measured}
        for name, trials in by_name.items()
    }
    own = {name: replace(judged[name], chosen=values[name]) for name in names}
    best = ranked({name: own[name] for name in found}, first)
    others = ranked({name: own[name] for name in names if name not in found}, first)
    renamed = dict(zip(best, (f"found_{i}" for i in range(1, len(best) + 1)), strict=True))
    chosen = {renamed[name]: rig for name, rig in best.items()} | others

    def table(kind: str) -> pd.DataFrame:
        """A table of all evaluations, with the new names."""
        tables = [trial_results(trial, store, (), kind) for trial in plan.trials]
        whole = pd.concat(tables, ignore_index=True)
        placement = whole["placement"].map(aliases)
        return whole.assign(placement=placement.map(renamed).fillna(placement))

    searched = {name: rig.searched.get(first.name, float("nan")) for name, rig in chosen.items()}
    compared = verified_table(
        table("metrics"), table("left_out"), chosen, searched, baseline_of(chosen), generalist=True
    )
    return chosen, compared

"""The best rigs of a search by a generalist, judged again on traffic that it did not see."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd
from rich.console import Console

from sweeps.configuration.search import ObjectiveSettings
from sweeps.execution.backends import Backend, BackendLost
from sweeps.execution.execute import execute
from sweeps.execution.progress import StageProgress
from sweeps.plan.trial import DetectorTrial
from sweeps.results.trial_results import identity, with_columns
from sweeps.search.judgement.verify import verified_table
from sweeps.search.judgement.winners import Judged, baseline_of, ranked
from sweeps.search.problem.judged_sweep import JudgedRig, generalists, judged_rigs
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.aggregate import (
    Over,
    left_out_over_tests,
    metrics_over_tests,
    weighted_value,
)
from sweeps.store.open import AnyStore, reference
from sweeps.tasks.task import with_inputs

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
    measured = [o for o in problem.file.search.objective if o.measured]
    own_rigs = {alias: judged[name].rig for alias, name in aliases.items()}
    rigs = judged_rigs(problem, generalists(problem), own_rigs, problem.tests.choice)
    every = (trial for own in rigs.values() for tests in own for trial in tests)
    tasks = with_inputs(trial.evaluate for trial in every)
    store.refer(reference(problem.sweep(), "choice"), [task.key for task in tasks])
    with StageProgress(console, tasks, store) as progress:
        outcome = execute(tasks, store, backend, progress)
    for failure in outcome.failures.values():
        raise BackendLost(f"the best rigs could not be judged: {failure.reason}")
    over, classes = problem.file.search.over, problem.file.classes
    results = {
        name: _over_generalists(name, rigs[alias], store, over) for alias, name in aliases.items()
    }
    values = {
        name: {o.name: _value(o, classes, metrics) for o in measured}
        for name, (metrics, _) in results.items()
    }
    metrics, left_out = (
        pd.concat(tables, ignore_index=True) for tables in zip(*results.values(), strict=True)
    )
    own = {name: replace(judged[name], chosen=values[name]) for name in names}
    best = ranked({name: own[name] for name in found}, first)
    others = ranked({name: own[name] for name in names if name not in found}, first)
    renamed = dict(zip(best, (f"found_{i}" for i in range(1, len(best) + 1)), strict=True))
    chosen = {renamed[name]: rig for name, rig in best.items()} | others

    def by_new_names(table: pd.DataFrame) -> pd.DataFrame:
        """With the names in the order of the choice."""
        return table.assign(placement=table["placement"].map(renamed).fillna(table["placement"]))

    searched = {name: rig.searched.get(first.name, float("nan")) for name, rig in chosen.items()}
    compared = verified_table(
        by_new_names(metrics),
        by_new_names(left_out),
        chosen,
        searched,
        baseline_of(chosen),
        generalist=True,
    )
    return chosen, compared


def _over_generalists(
    name: str, judged: JudgedRig, store: AnyStore, over: Over
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Metrics of a rig by all generalists; the same without each unit."""
    metrics, left_out = zip(*(_results(name, tests, store, over) for tests in judged), strict=True)
    return pd.concat(metrics, ignore_index=True), pd.concat(left_out, ignore_index=True)


def _results(
    name: str, tests: Sequence[DetectorTrial], store: AnyStore, over: Over
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Metrics of a rig by one generalist, over all tests; the same without each unit."""
    evaluations = [trial.evaluate for trial in tests]
    metrics = [store.read(task, lambda found: found.metrics) for task in evaluations]
    left_out = [store.read(task, lambda found: found.left_out) for task in evaluations]
    truths = [tuple(t.key for t in e.inputs if t.stage == "ground_truth") for e in evaluations]
    traffic = [truths.index(own) + 1 for own in truths]
    columns = identity(tests[0], ()) | {"placement": name}
    return (
        with_columns(metrics_over_tests(metrics, over), columns),
        with_columns(left_out_over_tests(left_out, traffic, over), columns),
    )


def _value(objective: ObjectiveSettings, classes: Sequence[str], metrics: pd.DataFrame) -> float:
    """An objective of a rig, mean over the generalists."""
    values = [weighted_value(objective, classes, own) for _, own in metrics.groupby("seed")]
    return math.fsum(values) / len(values)

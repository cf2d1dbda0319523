"""Rigs judged by a generalist on traffic that the search did not see: its best, the cheapest."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from statistics import fmean

import pandas as pd
from rich.console import Console

from lidarplace.base.errors import InputError
from sweeps.execution.backends import Backend, BackendLost
from sweeps.execution.execute import execute
from sweeps.execution.progress import StageProgress
from sweeps.execution.runner import run_tasks
from sweeps.plan.trial import DetectorTrial
from sweeps.results.trial_results import identity, with_columns
from sweeps.search.problem.choice import Choices
from sweeps.search.problem.judged_sweep import generalists, judged_rigs
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.aggregate import left_out_over_tests, metrics_over_tests, weighted_value
from sweeps.search.verification.verify import verified_table
from sweeps.search.verification.winners import Judged, baseline_of, ranked
from sweeps.stages.task import with_inputs
from sweeps.store.local import Store
from sweeps.store.open import reference

MOST_CHOSEN = 8
"""Rigs of the search among which is chosen."""


def choose(
    console: Console, problem: Problem, judged: Mapping[str, Judged], store: Store, backend: Backend
) -> tuple[dict[str, Judged], pd.DataFrame]:
    """The best rigs of the search and the paper's on the traffic of the choice: those that were
    found in their new order and names, then the others; and the table of `verified_table`. Raises
    BackendLost: a rig could not be judged."""
    first = problem.file.search.objective[0]
    found = [name for name, own in judged.items() if own.role == "found"][:MOST_CHOSEN]
    names = [*found, *(name for name, own in judged.items() if own.role != "found")]
    measured = [o for o in problem.file.search.objective if o.measured]
    # Names of the paper's placements are taken.
    aliases = {f"judged_{number}": judged[name].rig for number, name in enumerate(names, start=1)}
    rigs = judged_rigs(problem, generalists(problem), aliases, problem.tests.choice)
    trials = (trial for own in rigs.values() for tests in own for trial in tests)
    tasks = with_inputs(trial.evaluate for trial in trials)
    store.refer(reference(problem.sweep(), "choice"), [task.key for task in tasks])
    with StageProgress(console, tasks, store) as progress:
        failures = execute(tasks, store, backend, progress).failures
    for failure in failures.values():
        raise BackendLost(f"the best rigs could not be judged: {failure.reason}")
    classes, every = problem.file.classes, zip(names, rigs.values(), strict=True)
    tables = [_results(name, tests, store, problem) for name, own in every for tests in own]
    metrics, left_out = (pd.concat(own, ignore_index=True) for own in zip(*tables, strict=True))
    worth = {}
    for name, of_rig in metrics.groupby("placement", sort=False):
        seeds = [own for _, own in of_rig.groupby("seed")]
        values = {o.name: fmean(weighted_value(o, classes, own) for own in seeds) for o in measured}
        worth[str(name)] = replace(judged[str(name)], chosen=values)
    best = ranked({name: worth[name] for name in found}, first)
    others = ranked({name: worth[name] for name in names if name not in found}, first)
    renamed = dict(zip(best, (f"found_{i}" for i in range(1, len(best) + 1)), strict=True))
    chosen = {renamed[name]: rig for name, rig in best.items()} | others
    searched = {name: rig.searched.get(first.name, math.nan) for name, rig in chosen.items()}
    metrics, left_out = (
        table.assign(placement=[renamed.get(name, name) for name in table["placement"]])
        for table in (metrics, left_out)
    )
    baseline = baseline_of(chosen)
    return chosen, verified_table(metrics, left_out, chosen, searched, baseline, generalist=True)


def _results(
    name: str, tests: Sequence[DetectorTrial], store: Store, problem: Problem
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Metrics of a rig by one generalist, over all tests; the same without each unit."""
    evaluations, over = [trial.evaluate for trial in tests], problem.file.search.over
    metrics = [store.read(task, lambda found: found.metrics) for task in evaluations]
    left_out = [store.read(task, lambda found: found.left_out) for task in evaluations]
    truths = [[task.key for task in trial.test_truths] for trial in tests]
    traffic = [truths.index(own) + 1 for own in truths]
    columns = identity(tests[0], ()) | {"placement": name}
    return (
        with_columns(metrics_over_tests(metrics, over), columns),
        with_columns(left_out_over_tests(left_out, traffic, over), columns),
    )


def recall_of(
    console: Console, problem: Problem, store: Store
) -> Callable[[Choices], float] | None:
    """Ask the first objective of a rig, percent; None where `search.cheapest.recall` is null.
    Results are kept in the store. The returned function raises BackendLost if a rig cannot be
    judged. Raises ValueError: the objective is not of the generalist of the package."""
    search = problem.file.search
    if search.cheapest.recall is None:
        return None
    objective, classes = search.objective[0], problem.file.classes
    if not problem.pretrained:
        key, own = "search.cheapest.recall", "objective: pretrained.recall or another of pretrained"
        raise InputError(place=problem.path, key=key, expected=own, found=objective.name)

    def recall(rig: Choices) -> float:
        if (outside := problem.outside(rig)) is not None:
            console.print(f"not judged: {outside}", soft_wrap=True)
            return -math.inf
        judged = judged_rigs(problem, {}, {"cheapest_rig": rig}, problem.tests.choice)
        (tests,) = judged["cheapest_rig"]
        tasks = with_inputs(trial.evaluate for trial in tests)
        for failure in run_tasks(console, problem.file, store, tasks).values():
            raise BackendLost(f"a rig could not be judged: {failure.reason}")
        found = [store.read(trial.evaluate, lambda own: own.metrics) for trial in tests]
        return weighted_value(objective, classes, metrics_over_tests(found, search.over))

    return recall

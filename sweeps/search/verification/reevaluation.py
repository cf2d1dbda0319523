"""Evaluation by a generalist on traffic that the search did not see: of its best, the cheapest."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
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
from sweeps.search.problem.generalist_trials import TrialsOfRig, generalists, trials_of_rigs
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig
from sweeps.search.trials.aggregate import left_out_over_tests, metrics_over_tests, weighted_value
from sweeps.search.verification.verify import verified_table
from sweeps.search.verification.winners import AssessedRig, baseline_of, ranked
from sweeps.stages.task import with_inputs
from sweeps.store.local import Store
from sweeps.store.open import reference

MOST_REEVALUATED = 8
"""Number of rigs of the search that are evaluated again."""


def reevaluate(
    console: Console,
    problem: SearchProblem,
    rigs: Mapping[str, AssessedRig],
    store: Store,
    backend: Backend,
) -> tuple[dict[str, AssessedRig], pd.DataFrame]:
    """Evaluate the best rigs of the search and the paper's on the traffic of the choice.

    Returns the rigs that were found, in their new order and under new names, then the others; and
    the table of `verified_table`. Raises BackendLost: a rig could not be evaluated."""
    first = problem.file.search.objective[0]
    found_names = [name for name, rig in rigs.items() if rig.role == "found"][:MOST_REEVALUATED]
    names = [*found_names, *(name for name, rig in rigs.items() if rig.role != "found")]
    # Names of the paper's placements are taken.
    aliases = {f"judged_{number}": rigs[name].rig for number, name in enumerate(names, start=1)}
    trials = trials_of_rigs(problem, generalists(problem), aliases, problem.tests.choice)
    _evaluate(console, problem, trials.values(), store, backend)
    tables = [
        _results(name, tests, store, problem)
        for name, of_generalists in zip(names, trials.values(), strict=True)
        for tests in of_generalists
    ]
    metrics, left_out = (pd.concat(kind, ignore_index=True) for kind in zip(*tables, strict=True))
    evaluated = {
        str(name): replace(rigs[str(name)], chosen=_values(table, problem))
        for name, table in metrics.groupby("placement", sort=False)
    }
    best = ranked({name: evaluated[name] for name in found_names}, first)
    others = ranked({name: evaluated[name] for name in names if name not in best}, first)
    renamed = {name: f"found_{number}" for number, name in enumerate(best, start=1)}
    chosen = {renamed[name]: rig for name, rig in best.items()} | others
    searched = {name: rig.searched.get(first.name, math.nan) for name, rig in chosen.items()}
    metrics, left_out = (
        table.assign(placement=[renamed.get(name, name) for name in table["placement"]])
        for table in (metrics, left_out)
    )
    baseline = baseline_of(chosen)
    return chosen, verified_table(metrics, left_out, chosen, searched, baseline, generalist=True)


def _evaluate(
    console: Console,
    problem: SearchProblem,
    trials: Iterable[TrialsOfRig],
    store: Store,
    backend: Backend,
) -> None:
    tests = (trial for of_rig in trials for of_generalist in of_rig for trial in of_generalist)
    tasks = with_inputs(trial.evaluate for trial in tests)
    store.refer(reference(problem.sweep(), "choice"), [task.key for task in tasks])
    with StageProgress(console, tasks, store) as progress:
        failures = execute(tasks, store, backend, progress).failures
    for failure in failures.values():
        raise BackendLost(f"the best rigs could not be evaluated: {failure.reason}")


def _values(metrics: pd.DataFrame, problem: SearchProblem) -> dict[str, float]:
    """Return the measured objectives of one rig by name, the mean over the generalists."""
    classes, seeds = problem.file.classes, [table for _, table in metrics.groupby("seed")]
    return {
        objective.name: fmean(weighted_value(objective, classes, table) for table in seeds)
        for objective in problem.file.search.objective
        if objective.measured
    }


def _results(
    name: str, tests: Sequence[DetectorTrial], store: Store, problem: SearchProblem
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return metrics of a rig by one generalist, over all tests; and the same without each unit."""
    evaluations, over = [trial.evaluate for trial in tests], problem.file.search.over
    metrics = [store.read(task, lambda result: result.metrics) for task in evaluations]
    left_out = [store.read(task, lambda result: result.left_out) for task in evaluations]
    truths = [[task.key for task in trial.test_truths] for trial in tests]
    traffic = [truths.index(keys) + 1 for keys in truths]
    columns = identity(tests[0], ()) | {"placement": name}
    return (
        with_columns(metrics_over_tests(metrics, over), columns),
        with_columns(left_out_over_tests(left_out, traffic, over), columns),
    )


def recall_of(
    console: Console, problem: SearchProblem, store: Store
) -> Callable[[Rig], float] | None:
    """Return a function of the first objective of a rig, percent; None if it has no limit.

    The limit is `search.cheapest.recall`. Results are kept in the store. The returned function
    raises BackendLost if a rig cannot be evaluated. Raises ValueError: the objective is not of the
    generalist of the package."""
    search = problem.file.search
    if search.cheapest.recall is None:
        return None
    objective, classes = search.objective[0], problem.file.classes
    if not problem.pretrained:
        key, expected = (
            "search.cheapest.recall",
            "objective: pretrained.recall or another of pretrained",
        )
        raise InputError(place=problem.path, key=key, expected=expected, found=objective.name)

    def recall(rig: Rig) -> float:
        if (outside := problem.outside(rig)) is not None:
            console.print(f"not evaluated: {outside}", soft_wrap=True)
            return -math.inf
        trials = trials_of_rigs(problem, {}, {"cheapest_rig": rig}, problem.tests.choice)
        (tests,) = trials["cheapest_rig"]
        tasks = with_inputs(trial.evaluate for trial in tests)
        for failure in run_tasks(console, problem.file, store, tasks).values():
            raise BackendLost(f"a rig could not be evaluated: {failure.reason}")
        metrics = [store.read(trial.evaluate, lambda result: result.metrics) for trial in tests]
        return weighted_value(objective, classes, metrics_over_tests(metrics, search.over))

    return recall

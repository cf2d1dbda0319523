"""What the generalist of the package finds with a rig, on the traffic of the choice."""

import math

from rich.console import Console

from sweeps.execution.backends import BackendLost
from sweeps.execution.runner import run_tasks
from sweeps.search.cheapest.choose import Recall
from sweeps.search.problem.choice import Choices
from sweeps.search.problem.judged_sweep import judged_rigs
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.aggregate import metrics_over_tests, weighted_value
from sweeps.store.local import Store
from sweeps.tasks.task import with_inputs


def recall_of(console: Console, problem: Problem, store: Store) -> Recall | None:
    """Ask the first objective of a rig, percent; None where `search.cheapest.recall` is null.
    Results are kept in the store. The returned function raises BackendLost if a rig cannot be
    judged. Raises ValueError: the objective is not of the generalist of the package."""
    search = problem.file.search
    if search.cheapest.recall is None:
        return None
    objective, classes = search.objective[0], problem.file.classes
    if not problem.pretrained:
        raise ValueError(
            f"{problem.path}: search.cheapest.recall: no generalist judges rigs; expected "
            f"objective: pretrained.recall or another of pretrained, found {objective.name}"
        )

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

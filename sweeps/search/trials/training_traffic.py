"""The training traffic that a search looks at, from the store or computed like a sweep's."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rich.console import Console

from lidarplace import ExpectedRecall
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES
from sweeps.execution.backends import Backend
from sweeps.execution.execute import execute
from sweeps.execution.progress import StageProgress
from sweeps.plan.plan import RECALL_FRAMES
from sweeps.search.problem.assess import Traffic
from sweeps.search.problem.problem import Problem
from sweeps.store.of_sweep import reference
from sweeps.store.open import AnyStore
from sweeps.tasks.parameters import RecallParams
from sweeps.tasks.stages import grids_of, objects_of
from sweeps.tasks.task import Task


class NoTraffic(RuntimeError):
    """A task that leads to the traffic failed, or nothing is in it."""


def training_traffic(
    console: Console,
    problem: Problem,
    store: AnyStore,
    backend: Backend,
    scene: Mapping[str, Any] | None = None,
) -> Traffic:
    """What the objectives ask for.

    Args:
        scene: key path -> value, what is different from the configuration.

    Raises:
        ConfigError: a value is not allowed at its key path.
        NoTraffic: something failed, or `expected_recall` is asked of a class of which no object
            counts.
    """
    if not problem.question.needs_pog:
        return Traffic({})
    sweep = problem.sweep(scene)
    tasks, trial = problem.pog_tasks(sweep)
    purpose = "search" if scene is None else f"search-{trial.pog.key[:6]}"
    store.refer(reference(sweep, purpose), [task.key for task in tasks])
    with StageProgress(console, tasks, store) as progress:
        failures = execute(tasks, store, backend, progress).failures
    for failure in failures.values():
        raise NoTraffic(failure.reason)
    grids = grids_of(store.load(trial.pog))
    if not problem.question.needs_objects:
        return Traffic(grids)
    assert trial.recall is not None
    objects = _objects(problem, store, trial.recall)
    frames = next(iter(grids.values())).frames
    console.print(
        f"expected_recall: {len(objects.objects.table):,} objects that count, in "
        f"{min(RECALL_FRAMES, frames)} of {frames} training frames"
    )
    return Traffic(grids, objects)


def _objects(problem: Problem, store: AnyStore, recall: Task) -> ExpectedRecall:
    """The objects of which the objectives are, under rigs as clouds are collected."""
    file = problem.file
    params = recall.params
    assert isinstance(params, RecallParams)
    asked = [o for o in file.search.objective if o.by in OBJECT_SURROGATES]
    weighted = {name for objective in asked for name in objective.weights_of(file.classes)}
    params = replace(params, classes=tuple(name for name in file.classes if name in weighted))
    logs = [store.load(task) for task in recall.inputs]
    model = objects_of(params, logs, azimuth_share=file.lidar.cloud_share)
    missing = weighted - set(model.objects.table["class"])
    if missing:
        raise NoTraffic(
            f"expected_recall: no {min(missing)} counts in the training frames; "
            "ask for the other classes, such as expected_recall.Car"
        )
    return model

"""The POG that a search looks at, from the store or computed like a sweep's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Console

from lidarplace import OccupancyGrid
from sweeps.execution.backends import Backend
from sweeps.execution.execute import execute
from sweeps.execution.progress import StageProgress
from sweeps.search.problem.problem import Problem
from sweeps.store.of_sweep import reference
from sweeps.store.open import AnyStore
from sweeps.tasks.stages import grids_of


class NoPog(RuntimeError):
    """A task that leads to the POG failed."""


def pog(
    console: Console,
    problem: Problem,
    store: AnyStore,
    backend: Backend,
    scene: Mapping[str, Any] | None = None,
) -> dict[str, OccupancyGrid]:
    """POG by class.

    Args:
        scene: key path -> value, what is different from the configuration.

    Raises:
        ConfigError: a value is not allowed at its key path.
        NoPog: something failed.
    """
    sweep = problem.sweep(scene)
    tasks, trial = problem.pog_tasks(sweep)
    purpose = "search" if scene is None else f"search-{trial.pog.key[:6]}"
    store.refer(reference(sweep, purpose), [task.key for task in tasks])
    with StageProgress(console, tasks, store.finished(tasks)) as progress:
        failures = execute(tasks, store, backend, progress).failures
    for failure in failures.values():
        raise NoPog(failure.reason)
    return grids_of(store.load(trial.pog))

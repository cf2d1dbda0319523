"""Run tasks that belong to no trial, such as the scenes of a sweep alone."""

from collections.abc import Mapping, Sequence

from rich.console import Console

from sweeps.configuration.sweep import Common
from sweeps.execution.backends import backend_for
from sweeps.execution.execute import execute
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.progress import StageProgress
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task


def run_tasks(
    console: Console,
    common: Common,
    store: AnyStore,
    tasks: Sequence[Task],
    failures: FailureFolder | None = None,
) -> Mapping[str, Failure]:
    """Run what is not in the store yet. Returns the failures by key.

    Args:
        failures: keeps them for a reader.
    """
    with (
        store.in_use(),
        backend_for(common.ray) as backend,
        StageProgress(console, tasks, store, failures) as progress,
    ):
        return execute(tasks, store, backend, progress).failures

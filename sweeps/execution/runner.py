"""The frame of runs: one driver, its workers, MLflow; and tasks that belong to no trial."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

from rich.console import Console

from lidarplace.command_line.verbs import wrong
from lidarplace.files.atomic import remove_leftovers
from sweeps.configuration.sweep import Common
from sweeps.execution.backends import Backend, backend_for
from sweeps.execution.execute import execute
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.progress import StageProgress
from sweeps.stages.task import Task
from sweeps.store.local import Store
from sweeps.store.lock import locked
from tracking.mlflow.content import ParentRun
from tracking.mlflow.log import SweepLog
from tracking.mlflow.uri import sqlite_file, ui_command

T = TypeVar("T")

Say = Callable[[str], None]
"""Prints a line."""


class Work(Protocol[T]):
    """A sweep or a search, step by step; each step resumes what an earlier run left."""

    def open(self, folder: Path, say: Say) -> ParentRun:
        """Prepare the run folder, which no other driver has, and the store.

        Returns the state of MLflow. Raises ValueError: something that is needed is missing."""

    def compute(self, folder: Path, backend: Backend, log: SweepLog, say: Say) -> T:
        """Run all that has no result yet, and log it."""

    def report(self, folder: Path, results: T, log: SweepLog) -> Path | None:
        """Write, print and log the results. Returns the file of the report, if there is one."""


def drive(console: Console, common: Common, store: Store, work: Work[T]) -> tuple[T, bool]:
    """Run a sweep or a search from where it stopped.

    Returns the results, and whether MLflow received all. Raises typer.Exit: another driver runs it,
    or MLflow, Ray or a database is not available; BackendLost: Ray has gone; DamagedResult: a
    result was damaged, and is computed again when this is called again; OSError: the run folder
    cannot be written."""
    folder = common.output / common.name
    say = partial(console.print, soft_wrap=True)
    with ExitStack() as stack:
        workers = ExitStack()  # given back before the results are written
        try:
            stack.enter_context(locked(folder, alone=True))
            _remove_leftovers(common, store)
            log = SweepLog(common.tracking_uri, work.open(folder, say), folder=folder, say=say)
            stack.enter_context(store.in_use())
            stack.enter_context(log)
            stack.enter_context(workers)
            backend = workers.enter_context(backend_for(common.ray))
        except ValueError as error:
            wrong(error)
        with workers:
            results = work.compute(folder, backend, log, say)
        report = work.report(folder, results, log)
        if report is not None:
            say(f"Report  {report}")
        say(f"MLflow  {ui_command(common.tracking_uri, log.page())}")
    return results, not log.undelivered and not log.refused


def _remove_leftovers(common: Common, store: Store) -> None:
    """Remove partial files of killed runs; in a shared store those of others stay."""
    remove_leftovers(common.output / common.name, "**/.*.part*")
    if (database := sqlite_file(common.tracking_uri)) is not None:
        remove_leftovers(database.parent)
    remove_leftovers(store.folder, "*/.*.part*")


def run_tasks(
    console: Console,
    common: Common,
    store: Store,
    tasks: Sequence[Task],
    failures: FailureFolder | None = None,
) -> Mapping[str, Failure]:
    """Run the tasks without a result. Returns failures by key; `failures` keeps them."""
    with (
        store.in_use(),
        backend_for(common.ray) as backend,
        StageProgress(console, tasks, store, failures) as progress,
    ):
        return execute(tasks, store, backend, progress).failures

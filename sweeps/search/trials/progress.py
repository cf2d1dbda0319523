"""What a search does now: a bar of trials in a terminal, elsewhere a line now and then."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from sweeps.execution.failures import Failure
from sweeps.execution.progress_lines import ProgressLines
from sweeps.execution.running import Running, RunningColumn, about
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task


class TrialProgress:
    """Shows how many trials are finished, and what their tasks do meanwhile.

    Use as a context manager and as the executor's listener.

    Args:
        wanted: number of trials.
        store: has notes of what runs.
    """

    def __init__(self, console: Console, wanted: int, store: AnyStore) -> None:
        self._console = console
        self._wanted = wanted
        self._told = 0
        self._batch: tuple[float, int] | None = None  # seconds and trials of the latest
        self._since: float | None = None
        self._running = Running(store.running_notes)
        self._lines = ProgressLines(console, self._now)
        self._progress = Progress(
            TextColumn("trials"),
            BarColumn(16),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            RunningColumn(),
            console=console,
            expand=True,
            disable=not console.is_terminal,
        )
        self._bar = self._progress.add_task("trials", total=wanted, now=self._running.__str__)

    def __enter__(self) -> TrialProgress:
        self._progress.start()
        self._lines.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.__exit__()
        self._progress.stop()

    def told(self, number: int) -> None:
        """So many trials are finished."""
        before, now = self._told, time.monotonic()
        # The first batch has what is done once, such as the training of a generalist.
        self._batch = None if self._since is None else (now - self._since, number - before)
        self._since, self._told = now, number
        self._progress.update(self._bar, completed=number)
        if not self._console.is_terminal and 10 * number // self._wanted > (
            10 * before // self._wanted
        ):
            self._console.print(f"trials {number}/{self._wanted}")

    def started(self, task: Task) -> None:
        self._running.started(task)

    def finished(self, task: Task) -> None:
        self._running.ended(task)

    def failed(self, task: Task, failure: Failure) -> None:
        """The trial tells why."""
        self.finished(task)

    def _now(self) -> str:
        """How many trials are finished, what runs, and when the last may be."""
        parts = [f"trials {self._told} of {self._wanted}"]
        if now := str(self._running):
            parts.append(f"now {now}")
        if self._batch is not None:
            seconds, trials = self._batch
            parts.append(f"about {about(seconds / trials * (self._wanted - self._told))} left")
        return "; ".join(parts)

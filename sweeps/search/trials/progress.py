"""What a search does now: a bar of trials in a terminal, elsewhere a line now and then."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from lidarplace.command_line.terminal import visible
from sweeps.execution.failures import Failure
from sweeps.execution.progress_lines import ProgressLines
from sweeps.execution.running import Running, about, running_column
from sweeps.tasks.task import Task


class TrialProgress:
    """Shows how many trials are finished, and what their tasks do meanwhile.

    Use as a context manager and as the executor's listener.

    Args:
        wanted: number of trials.
    """

    def __init__(self, console: Console, wanted: int) -> None:
        self._console = console
        self._wanted = wanted
        self._told = 0
        self._batch: tuple[float, int] | None = None  # seconds and trials of the latest
        self._since: float | None = None
        self._running = Running()
        self._lines = ProgressLines(console, self._now)
        self._progress = Progress(
            TextColumn("trials"),
            BarColumn(16),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            running_column(),
            console=console,
            expand=True,
            disable=not console.is_terminal,
        )
        self._bar = self._progress.add_task("trials", total=wanted, now="")

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
            self._console.print(f"trials {number}/{self._wanted}", highlight=False)

    def started(self, task: Task) -> None:
        self._running.started(task)
        self._show()

    def finished(self, task: Task) -> None:
        self._running.ended(task)
        self._show()

    def failed(self, task: Task, failure: Failure) -> None:
        """The trial tells why."""
        self.finished(task)

    def _show(self) -> None:
        self._progress.update(self._bar, now=visible(str(self._running)))

    def _now(self) -> str:
        """How many trials are finished, what runs, and when the last may be."""
        parts = [f"trials {self._told} of {self._wanted}"]
        if now := str(self._running):
            parts.append(f"now {now}")
        if self._batch is not None:
            seconds, trials = self._batch
            parts.append(f"about {about(seconds / trials * (self._wanted - self._told))} left")
        return "; ".join(parts)

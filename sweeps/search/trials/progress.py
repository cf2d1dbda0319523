"""What a search does now: a bar of trials in a terminal, elsewhere a line now and then."""

import time

from rich.console import Console

from sweeps.execution.failures import Failure
from sweeps.execution.progress import StageProgress, about
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task


class TrialProgress(StageProgress):
    """Shows how many of the `wanted` trials are finished, and what their tasks do meanwhile."""

    def __init__(self, console: Console, wanted: int, store: AnyStore) -> None:
        super().__init__(console, (), store)
        self._wanted = wanted
        self._told = 0
        self._batch: tuple[float, int] | None = None  # seconds and trials of the latest
        self._since: float | None = None
        self._trials = self._bars.add_task("trials", total=wanted, now=self._running.__str__)

    def told(self, number: int) -> None:
        """So many trials are finished."""
        before, now = self._told, time.monotonic()
        # The first batch has what is done once, such as the training of a generalist.
        self._batch = None if self._since is None else (now - self._since, number - before)
        self._since, self._told = now, number
        self._bars.update(self._trials, completed=number)
        if not self._console.is_terminal and 10 * number // self._wanted > (
            10 * before // self._wanted
        ):
            self._console.print(f"trials {number}/{self._wanted}")

    def failed(self, task: Task, failure: Failure) -> None:
        """The trial has the reason."""
        self._running.ended(task)

    def now(self) -> str:
        """How many trials are finished, what runs, and when the last may be."""
        parts = [f"trials {self._told} of {self._wanted}"]
        if now := str(self._running):
            parts.append(f"now {now}")
        if self._batch is not None:
            seconds, trials = self._batch
            parts.append(f"about {about(seconds / trials * (self._wanted - self._told))} left")
        return "; ".join(parts)

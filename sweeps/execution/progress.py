"""What a sweep does now: a bar for every stage in a terminal; elsewhere a line for every stage that
is done, and one now and then on what runs and what is left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.table import Column

from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.run_progress import RunProgress
from sweeps.execution.running import about
from sweeps.execution.time_left import TimeLeft
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task


class StageProgress(RunProgress):
    """Shows how far every stage is. Use as a context manager and as the executor's listener.

    Args:
        tasks: those to expect; of a stage that is not among them nothing is shown.
        store: has results, and notes of what runs.
        failures: keeps why tasks failed.
    """

    def __init__(
        self,
        console: Console,
        tasks: Sequence[Task],
        store: AnyStore,
        failures: FailureFolder | None = None,
    ) -> None:
        bar, number, left = (Column(min_width=width, no_wrap=True) for width in (17, 5, 5))
        super().__init__(
            console,
            store,
            TextColumn("{task.description}", markup=False, table_column=bar),
            BarColumn(16),
            MofNCompleteColumn(table_column=number),
            TimeRemainingColumn(compact=True, table_column=left),
        )
        self._failures = failures
        self._total = Counter(task.stage for task in tasks)
        cached = store.finished(tasks)
        self._done = Counter(task.stage for task in tasks if task.key in cached)
        self._failed: Counter[str] = Counter()
        self._left = TimeLeft(task for task in tasks if task.key not in cached)
        self._bar = {
            stage: self._bars.add_task(
                stage.replace("_", " "),
                total=total,
                completed=self._done[stage],
                now=partial(self._running.labels, stage),
            )
            for stage, total in self._total.items()
        }

    def finished(self, task: Task) -> None:
        self._ended(task)

    def failed(self, task: Task, failure: Failure) -> None:
        text = f"failed: {task.stage} '{task.label}': {failure.reason}"
        self._console.print(text, soft_wrap=True)
        if self._failures is not None:
            self._failures.write(task, failure)
        self._failed[task.stage] += 1
        self._ended(task)

    def _ended(self, task: Task) -> None:
        stage, seconds = task.stage, self._running.ended(task)
        if stage not in self._total:
            return
        self._done[stage] += 1
        self._left.ended(stage, seconds)
        self._bars.update(self._bar[stage], completed=self._done[stage])
        if self._bars.disable and self._done[stage] == self._total[stage]:
            failed = self._failed[stage]
            text = f"{stage}: {self._total[stage] - failed} done"
            self._console.print(text + (f", {failed} failed" if failed else ""))

    def now(self) -> str:
        """How far the stages are that are not done, what runs, and when it may end."""
        open_ = [s for s, total in self._total.items() if self._done[s] < total]
        left = [f"{stage} {self._done[stage]} of {self._total[stage]}" for stage in open_]
        seconds = self._left.seconds(self._running, self.elapsed)
        ends = [] if seconds is None else [f"about {about(seconds)} left"]
        now = str(self._running)
        return "; ".join([", ".join(left), *([f"now {now}"] if now else []), *ends])

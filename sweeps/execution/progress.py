"""What a sweep does now: a bar for every stage in a terminal; elsewhere a line for every stage that
is done, and one now and then on what runs and what is left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.progress_lines import ProgressLines
from sweeps.execution.running import Running, RunningColumn, about
from sweeps.execution.time_left import TimeLeft
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task


class StageProgress:
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
        self._console = console
        self._failures = failures
        self._total = Counter(task.stage for task in tasks)
        cached = store.finished(tasks)
        self._done = Counter(task.stage for task in tasks if task.key in cached)
        self._failed: Counter[str] = Counter()
        self._running = Running(store.running_notes)
        self._left = TimeLeft(task for task in tasks if task.key not in cached)
        self._lines = ProgressLines(console, self._now)
        self._progress = Progress(
            TextColumn(
                "{task.description}", markup=False, table_column=Column(min_width=17, no_wrap=True)
            ),
            BarColumn(16),
            MofNCompleteColumn(table_column=Column(min_width=5, no_wrap=True)),
            TimeRemainingColumn(compact=True, table_column=Column(min_width=5, no_wrap=True)),
            RunningColumn(),
            console=console,
            expand=True,
            disable=not console.is_terminal,
        )
        self._bars = {
            stage: self._progress.add_task(
                stage.replace("_", " "),
                total=total,
                completed=self._done[stage],
                now=partial(self._running.labels, stage),
            )
            for stage, total in self._total.items()
        }

    def __enter__(self) -> StageProgress:
        self._progress.start()
        self._lines.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.__exit__()
        self._progress.stop()

    def started(self, task: Task) -> None:
        self._running.started(task)

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
        self._progress.update(self._bars[stage], completed=self._done[stage])
        if self._progress.disable and self._done[stage] == self._total[stage]:
            failed = self._failed[stage]
            text = f"{stage}: {self._total[stage] - failed} done"
            self._console.print(text + (f", {failed} failed" if failed else ""))

    def _now(self) -> str:
        """How far the stages are that are not done, what runs, and when it may end."""
        open_ = [s for s, total in self._total.items() if self._done[s] < total]
        left = [f"{stage} {self._done[stage]} of {self._total[stage]}" for stage in open_]
        seconds = self._left.seconds(self._running, self._lines.elapsed)
        ends = [] if seconds is None else [f"about {about(seconds)} left"]
        now = str(self._running)
        return "; ".join([", ".join(left), *([f"now {now}"] if now else []), *ends])

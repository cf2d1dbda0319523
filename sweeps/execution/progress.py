"""The progress of a sweep: a bar for every stage in a terminal, elsewhere lines.

There is a line for every stage that has finished, and one now and then on what runs and what is
left."""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from statistics import fmean
from typing import Self

from rich import progress as bars
from rich.console import Console
from rich.table import Column
from rich.text import Text

from lidarplace.command_line.terminal import visible
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.stages.task import Task
from sweeps.store.local import Note, Store

_MOST_NAMED = 2
NOTED_S = 10.0
"""Seconds between two notes of a training's progress."""


class RunningColumn(bars.ProgressColumn):
    """Column with the text of the field `now` of a bar, cut at the end of the line."""

    def __init__(self) -> None:
        super().__init__(Column(ratio=1, no_wrap=True, overflow="ellipsis"))

    def render(self, bar: bars.Task) -> Text:
        """Return the text of a bar."""
        return Text(visible(bar.fields["now"]()), "dim")


class Running:
    """Tasks that run; another thread than that of the driver reads them.

    `notes`: returns what workers noted of tasks, by key, such as `Store.running_notes`."""

    def __init__(
        self,
        notes: Callable[[Iterable[Task]], Mapping[str, Note]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._notes = notes
        self._clock = clock
        self._since: dict[str, tuple[Task, float]] = {}
        self._looked = -math.inf
        self._progress: dict[str, str] = {}

    def started(self, task: Task) -> None:
        """Note that a task starts."""
        self._since[task.key] = (task, self._clock())

    def ended(self, task: Task) -> float | None:
        """Return the seconds of a task; None if it never started, as one that it needs failed."""
        _, since = self._since.pop(task.key, (task, None))
        return None if since is None else self._clock() - since

    def seconds(self) -> list[tuple[str, float]]:
        """List the stage of every task, and the seconds that it has run."""
        now = self._clock()
        return [(task.stage.name, now - since) for task, since in list(self._since.values())]

    def labels(self, stage: str) -> str:
        """Name the tasks of a stage, with their progress."""
        tasks = [task for task, _ in list(self._since.values()) if task.stage.name == stage]
        return ", ".join(task.label + self._progress_of(task) for task in tasks)

    def __str__(self) -> str:
        """Name what runs; empty if nothing runs.

        Such as "finetune 'center, seed 1' for 4:30 (epoch 2 of 9, 20 %, about 18 min left), 2
        more"."""
        now, every = self._clock(), list(self._since.values())
        named = [
            f"{task.stage.name} '{task.label}' for {minutes(now - since)}{self._progress_of(task)}"
            for task, since in every[:_MOST_NAMED]
        ]
        more = len(every) - len(named)
        return ", ".join([*named, *([f"{more} more"] if more > 0 else [])])

    def _progress_of(self, task: Task) -> str:
        if task.stage.resumable and self._clock() - self._looked > NOTED_S:
            self._looked = self._clock()
            trainings = [t for t, _ in list(self._since.values()) if t.stage.resumable]
            with suppress(Exception):  # a remote store that does not answer is asked again later
                self._progress = {
                    key: f" ({note.progress})"
                    for key, note in self._notes(trainings).items()
                    if note.progress
                }
        return self._progress.get(task.key, "")


def minutes(seconds: float) -> str:
    """Format a time, such as 4:05 or 1:04:05."""
    whole = max(0, round(seconds))
    hours, rest = divmod(whole, 3600)
    clock = f"{rest // 60:02}:{rest % 60:02}"
    return f"{hours}:{clock}" if hours else clock.removeprefix("0")


def about(seconds: float) -> str:
    """Format an estimate of a time, such as 40 s, 5 min or 2.5 h."""
    if seconds < 60:
        return f"{max(10, 10 * round(seconds / 10))} s"
    if seconds < 90 * 60:
        return f"{round(seconds / 60)} min"
    return f"{seconds / 3600:.1f} h"


class TimeLeft:
    """Estimate of the time left, from tasks that ended: as many run at once as before."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._left = Counter(task.stage.name for task in tasks)
        self._seconds: dict[str, list[float]] = {}

    def ended(self, stage: str, seconds: float | None) -> None:
        """Note the seconds of a task, None if it never started."""
        self._left[stage] -= 1
        if seconds is not None:
            self._seconds.setdefault(stage, []).append(seconds)

    def seconds(self, running: Running, elapsed: float) -> float | None:
        """Return the seconds to the end, `elapsed` since the first task started.

        None while no task of a stage that is left has ended."""
        mean = {stage: fmean(seconds) for stage, seconds in dict(self._seconds).items()}
        left = {stage: count for stage, count in self._left.items() if count > 0}
        if not left.keys() <= mean.keys() or elapsed <= 0:
            return None
        now = [(stage, for_) for stage, for_ in running.seconds() if stage in mean]
        ran = sum(map(sum, dict(self._seconds).values())) + sum(for_ for _, for_ in now)
        at_once = max(1.0, ran / elapsed)
        work = sum(count * mean[stage] for stage, count in left.items())
        work -= sum(min(for_, mean[stage]) for stage, for_ in now)
        begun = Counter(stage for stage, _ in now)
        # No number of machines makes one task shorter.
        waiting = [mean[stage] for stage, count in left.items() if count > begun[stage]]
        return max(work / at_once, *waiting, *(mean[stage] - for_ for stage, for_ in now), 0.0)


FIRST_S = 30.0
"""Seconds between two lines at least."""
SHARE = 0.05
"""Share of the elapsed time between two lines at least: ten hours have a hundred lines."""


class StageProgress:
    """Listener of `execute` that shows how far every stage of `tasks` is.

    A thread prints the lines, as the driver may wait for a training for hours. `failures` keeps the
    failures of tasks."""

    def __init__(
        self,
        console: Console,
        tasks: Sequence[Task],
        store: Store,
        failures: FailureFolder | None = None,
    ) -> None:
        bar, number, left = (Column(min_width=width, no_wrap=True) for width in (17, 5, 5))
        self._console = console
        self._running = Running(store.running_notes)
        self._bars = bars.Progress(
            bars.TextColumn("{task.description}", markup=False, table_column=bar),
            bars.BarColumn(16),
            bars.MofNCompleteColumn(table_column=number),
            bars.TimeRemainingColumn(compact=True, table_column=left),
            RunningColumn(),
            console=console,
            expand=True,
            disable=not console.is_terminal,
        )
        self._start = time.monotonic()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="progress lines", daemon=True)
        self._failures = failures
        self._total = Counter(task.stage.name for task in tasks)
        cached = store.finished(tasks)
        self._done = Counter(task.stage.name for task in tasks if task.key in cached)
        self._failed = Counter[str]()
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

    def __enter__(self) -> Self:
        self._bars.start()
        if self._bars.disable:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        if self._bars.disable:
            self._thread.join()
        self._bars.stop()

    def started(self, task: Task) -> None:
        """Show a task that starts."""
        self._running.started(task)

    def finished(self, task: Task) -> None:
        """Show that a task has a result."""
        self._ended(task)

    def failed(self, task: Task, failure: Failure) -> None:
        """Print and keep a failure."""
        text = f"failed: {task.stage.name} '{task.label}': {failure.reason}"
        self._console.print(text, soft_wrap=True)
        if self._failures is not None:
            self._failures.write(task, failure)
        self._failed[task.stage.name] += 1
        self._ended(task)

    def _ended(self, task: Task) -> None:
        stage, seconds = task.stage.name, self._running.ended(task)
        if stage not in self._total:
            return
        self._done[stage] += 1
        self._left.ended(stage, seconds)
        self._bars.update(self._bar[stage], completed=self._done[stage])
        if self._bars.disable and self._done[stage] == self._total[stage]:
            failed = self._failed[stage]
            text = f"{stage}: {self._total[stage] - failed} done"
            self._console.print(text + (f", {failed} failed" if failed else ""))

    @property
    def _elapsed(self) -> float:
        return time.monotonic() - self._start

    def _run(self) -> None:
        while not self._stopped.wait(max(FIRST_S, SHARE * self._elapsed)):
            self._console.print(f"{minutes(self._elapsed):>7}  {self.now()}", soft_wrap=True)

    def now(self) -> str:
        """Describe how far unfinished stages are, what runs, and when it may end."""
        unfinished = [s for s, total in self._total.items() if self._done[s] < total]
        left = [f"{stage} {self._done[stage]} of {self._total[stage]}" for stage in unfinished]
        seconds = self._left.seconds(self._running, self._elapsed)
        ends = [] if seconds is None else [f"about {about(seconds)} left"]
        now = str(self._running)
        return "; ".join([", ".join(left), *([f"now {now}"] if now else []), *ends])

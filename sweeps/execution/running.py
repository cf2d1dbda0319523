"""Which tasks run now, and since when."""

import math
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress

from rich.progress import ProgressColumn
from rich.progress import Task as Bar
from rich.table import Column
from rich.text import Text

from lidarplace.command_line.terminal import visible
from sweeps.store.local import Note
from sweeps.tasks.task import Task

_MOST_NAMED = 2
NOTED_S = 10.0
"""Seconds between two notes of a training's progress."""


class RunningColumn(ProgressColumn):
    """What the field `now` of a bar returns: takes the rest of the line and is cut there."""

    def __init__(self) -> None:
        super().__init__(Column(ratio=1, no_wrap=True, overflow="ellipsis"))

    def render(self, bar: Bar) -> Text:
        """Called at every refresh."""
        return Text(visible(bar.fields["now"]()), "dim")


class Running:
    """Tasks between their start and their end; read by another thread than the driver's.

    Args:
        notes: what workers noted of tasks, by key, such as `Store.running_notes`.
        clock: seconds.
    """

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
        self._since[task.key] = (task, self._clock())

    def ended(self, task: Task) -> float | None:
        """Seconds that it ran, None if it never began: it fell with a task that it needs."""
        _, since = self._since.pop(task.key, (task, None))
        return None if since is None else self._clock() - since

    def seconds(self) -> list[tuple[str, float]]:
        """Stage of every task, and the seconds that it has run."""
        now = self._clock()
        return [(task.stage, now - since) for task, since in list(self._since.values())]

    def labels(self, stage: str) -> str:
        """Of the tasks of a stage."""
        own = [task for task, _ in list(self._since.values()) if task.stage == stage]
        return ", ".join(task.label + self._progress_of(task) for task in own)

    def __str__(self) -> str:
        """Such as "finetune 'center, seed 1' for 4:30 (epoch 2 of 9, 20 %, about 18 min left), 2
        more"; empty if nothing runs."""
        now, every = self._clock(), list(self._since.values())
        named = [
            f"{task.stage} '{task.label}' for {minutes(now - since)}{self._progress_of(task)}"
            for task, since in every[:_MOST_NAMED]
        ]
        more = len(every) - len(named)
        return ", ".join([*named, *([f"{more} more"] if more > 0 else [])])

    def _progress_of(self, task: Task) -> str:
        """What is noted of a training."""
        if task.resumable and self._clock() - self._looked > NOTED_S:
            self._looked = self._clock()
            trainings = [own for own, _ in list(self._since.values()) if own.resumable]
            with suppress(Exception):  # a remote store that does not answer is asked again later
                self._progress = {
                    key: f" ({note.progress})"
                    for key, note in self._notes(trainings).items()
                    if note.progress
                }
        return self._progress.get(task.key, "")


def minutes(seconds: float) -> str:
    """A time as 4:05 or 1:04:05."""
    whole = max(0, round(seconds))
    hours, rest = divmod(whole, 3600)
    clock = f"{rest // 60:02}:{rest % 60:02}"
    return f"{hours}:{clock}" if hours else clock.removeprefix("0")


def about(seconds: float) -> str:
    """An estimate as somebody says it: 40 s, 5 min, 2.5 h."""
    if seconds < 60:
        return f"{max(10, 10 * round(seconds / 10))} s"
    if seconds < 90 * 60:
        return f"{round(seconds / 60)} min"
    return f"{seconds / 3600:.1f} h"

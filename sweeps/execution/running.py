"""Which tasks run now, and since when."""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.progress import TextColumn
from rich.table import Column

from sweeps.tasks.task import Task

_MOST_NAMED = 2


def running_column() -> TextColumn:
    """What runs now, the field `now` of a bar: takes the rest of the line and is cut there."""
    rest = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    return TextColumn("{task.fields[now]}", style="dim", markup=False, table_column=rest)


class Running:
    """Tasks between their start and their end; read by another thread than the driver's.

    Args:
        clock: seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._since: dict[str, tuple[Task, float]] = {}

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

    def labels(self, stage: str) -> list[str]:
        """Of the tasks of a stage."""
        return [task.label for task, _ in list(self._since.values()) if task.stage == stage]

    def __str__(self) -> str:
        """Such as "finetune 'center, seed 1' for 4:30, 2 more"; empty if nothing runs."""
        now, every = self._clock(), list(self._since.values())
        named = [
            f"{task.stage} '{task.label}' for {minutes(now - since)}"
            for task, since in every[:_MOST_NAMED]
        ]
        more = len(every) - len(named)
        return ", ".join([*named, *([f"{more} more"] if more > 0 else [])])


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

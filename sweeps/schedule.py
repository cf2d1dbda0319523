"""Which task may run next."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence

from sweeps.stages import FUNCTIONS
from sweeps.task import Task

_DEPTH = {stage: depth for depth, stage in enumerate(FUNCTIONS)}


class Schedule:
    """Hands out tasks whose inputs are there, late stages first.

    So the first placement has its results before the clouds of the last one are collected.

    Args:
        tasks: all tasks, each after its inputs.
        done: keys of those whose results are in the store already.
    """

    def __init__(self, tasks: Sequence[Task], done: set[str]) -> None:
        self.failed: dict[str, str] = {}
        self._waiting: dict[str, int] = {}
        self._dependents: dict[str, list[Task]] = defaultdict(list)
        self._ready: list[tuple[int, int, Task]] = []
        self._order = {task.key: position for position, task in enumerate(tasks)}
        for task in tasks:
            if task.key in done:
                continue
            missing = [t for t in task.inputs if t.key not in done]
            self._waiting[task.key] = len(missing)
            for needed in missing:
                self._dependents[needed.key].append(task)
            if not missing:
                self._push(task)

    def _push(self, task: Task) -> None:
        heapq.heappush(self._ready, (-_DEPTH[task.stage], self._order[task.key], task))

    def next(self) -> Task | None:
        """A task to start, or None while all that are left wait for others."""
        return heapq.heappop(self._ready)[-1] if self._ready else None

    def finish(self, task: Task) -> None:
        """Note that a task has its result."""
        for dependent in self._dependents[task.key]:
            self._waiting[dependent.key] -= 1
            if self._waiting[dependent.key] == 0 and dependent.key not in self.failed:
                self._push(dependent)

    def fail(self, task: Task, reason: str) -> list[Task]:
        """Note that a task failed; returns it with all that cannot run without it."""
        fallen = [task]
        self.failed[task.key] = reason
        for current in fallen:
            for dependent in self._dependents[current.key]:
                if dependent.key not in self.failed:
                    self.failed[dependent.key] = f"needs {task.stage} '{task.label}', which failed"
                    fallen.append(dependent)
        return fallen

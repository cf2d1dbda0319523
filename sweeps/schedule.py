"""Which task may run next, and which results are still needed."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence

from sweeps.stages import FUNCTIONS
from sweeps.task import Task

_DEPTH = {stage: depth for depth, stage in enumerate(FUNCTIONS)}


class Schedule:
    """Hands out tasks whose inputs are there, late stages first.

    So a placement is trained before the clouds of the next one are collected, so
    few big results are alive at a time.

    Args:
        tasks: all tasks, each after its inputs.
        done: keys of those whose results are in the store already.
    """

    def __init__(self, tasks: Sequence[Task], done: set[str]) -> None:
        self.failed: dict[str, str] = {}
        self._waiting: dict[str, int] = {}
        self._dependents: dict[str, list[Task]] = defaultdict(list)
        self._users: dict[str, int] = defaultdict(int)
        self._ready: list[tuple[int, int, Task]] = []
        self._order = {task.key: position for position, task in enumerate(tasks)}
        for task in tasks:
            if task.key in done:
                continue
            missing = [t for t in task.inputs if t.key not in done]
            self._waiting[task.key] = len(missing)
            for needed in task.inputs:
                self._users[needed.key] += 1
            for needed in missing:
                self._dependents[needed.key].append(task)
            if not missing:
                self._push(task)

    def _push(self, task: Task) -> None:
        heapq.heappush(self._ready, (-_DEPTH[task.stage], self._order[task.key], task))

    def next(self) -> Task | None:
        """A task to start, or None while all that are left wait for others."""
        return heapq.heappop(self._ready)[-1] if self._ready else None

    def finish(self, task: Task) -> list[str]:
        """Note that a task has its result. Returns keys of results that nothing needs any more."""
        for dependent in self._dependents[task.key]:
            self._waiting[dependent.key] -= 1
            if self._waiting[dependent.key] == 0 and dependent.key not in self.failed:
                self._push(dependent)
        return self._release(task)

    def fail(self, task: Task, reason: str) -> tuple[list[Task], list[str]]:
        """Note that a task failed: what depends on it cannot run.

        Returns the failed task with all that fall with it, and keys of results that nothing needs
        any more.
        """
        fallen, unused = [task], []
        self.failed[task.key] = reason
        for current in fallen:
            unused += self._release(current)
            for dependent in self._dependents[current.key]:
                if dependent.key not in self.failed:
                    self.failed[dependent.key] = f"needs {task.stage} '{task.label}', which failed"
                    fallen.append(dependent)
        return fallen, unused

    def _release(self, task: Task) -> list[str]:
        unused = []
        for needed in task.inputs:
            self._users[needed.key] -= 1
            if self._users[needed.key] == 0:
                unused.append(needed.key)
        if self._users[task.key] == 0:
            unused.append(task.key)
        return unused

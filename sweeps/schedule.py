"""Which task may run next."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence

from sweeps.failures import Failure
from sweeps.stages import FUNCTIONS
from sweeps.task import Task

_DEPTH = {stage: depth for depth, stage in enumerate(FUNCTIONS)}


class Schedule:
    """Hands out tasks whose inputs are there, late stages first.

    So the first placement has its results before the clouds of the last one are collected.

    Args:
        tasks: all tasks, each after its inputs.
        done: keys of those whose results are in the store already.
        probes: probe that a task waits for, by the task's key; it goes on if the probe fails.

    Raises:
        ValueError: a task needs one that is neither done nor before it.
    """

    def __init__(
        self, tasks: Sequence[Task], done: Collection[str], probes: Mapping[str, Task]
    ) -> None:
        self.failed: dict[str, Failure] = {}
        self._waiting: dict[str, int] = {}
        self._dependents: dict[str, list[Task]] = defaultdict(list)
        self._ready: dict[bool, list[tuple[int, int, Task]]] = {False: [], True: []}
        self._order = {task.key: position for position, task in enumerate(tasks)}
        for task in tasks:
            if task.key in done:
                continue
            needed = [*task.inputs, *([probes[task.key]] if task.key in probes else [])]
            missing = [t for t in needed if t.key not in done]
            self._waiting[task.key] = len(missing)
            for item in missing:
                if item.key not in self._waiting:
                    raise ValueError(f"{task.stage} '{task.label}' comes before its input")
                self._dependents[item.key].append(task)
            if not missing:
                self._push(task)

    def _push(self, task: Task) -> None:
        entry = (-_DEPTH[task.stage], self._order[task.key], task)
        heapq.heappush(self._ready[task.gpu], entry)

    def next(self, gpu: bool = True) -> Task | None:
        """A task to start, or None while all that are left wait for others.

        Args:
            gpu: whether it may be one that runs on a GPU.
        """
        queues = [queue for kind, queue in self._ready.items() if queue and (gpu or not kind)]
        return heapq.heappop(min(queues, key=lambda queue: queue[0][:2]))[-1] if queues else None

    def again(self, task: Task) -> None:
        """Put a task back that was handed out."""
        self._push(task)

    def finish(self, task: Task) -> None:
        """Note that a task has its result."""
        for dependent in self._dependents[task.key]:
            self._waiting[dependent.key] -= 1
            if self._waiting[dependent.key] == 0 and dependent.key not in self.failed:
                self._push(dependent)

    def fail(self, task: Task, failure: Failure) -> list[Task]:
        """Note that a task failed; returns it with all that cannot run without it."""
        fallen: list[Task] = []
        falling = [(task, failure)]
        for current, why in falling:
            if current.key in self.failed:
                continue
            if current.stage == "probe":
                self.finish(current)  # trainings go on without what it would have told
                continue
            self.failed[current.key] = why
            fallen.append(current)
            reason = f"needs {current.stage} '{current.label}', which failed"
            because = Failure(reason, lasting=why.lasting, follows=True)
            falling += [(dependent, because) for dependent in self._dependents[current.key]]
        return fallen or [task]

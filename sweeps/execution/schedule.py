"""The order in which tasks run."""

import heapq
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace

from sweeps.execution.failures import Failure
from sweeps.stages.task import Task

_Rank = tuple[int, int, int]
"""Trial, order of the stage, place in the plan; the lowest goes first."""


class Schedule:
    """Hands out tasks whose inputs have results: trial by trial, and late stages first.

    So a sweep that is stopped has whole results of its first trials, not the trainings of all. Each
    of `tasks` comes after its inputs; the results of `finished` keys are in the store."""

    def __init__(self, tasks: Sequence[Task], finished: Collection[str]) -> None:
        self.failed: dict[str, Failure] = {}
        self._waiting: dict[str, int] = {}
        self._dependents: dict[str, list[Task]] = defaultdict(list)
        self._ready: dict[bool, list[tuple[_Rank, Task]]] = {False: [], True: []}
        self._rank: dict[str, _Rank] = {}
        trial = 0
        for position, task in enumerate(tasks):
            self._rank[task.key] = (trial, task.stage.order, position)
            trial += task.stage.ends_trial
        for task in tasks:
            if task.key in finished:
                continue
            missing = [t for t in task.inputs if t.key not in finished]
            self._waiting[task.key] = len(missing)
            for item in missing:
                if item.key not in self._waiting:
                    raise ValueError(f"{task.stage.name} '{task.label}' comes before its input")
                self._dependents[item.key].append(task)
            if not missing:
                self._push(task)

    def _push(self, task: Task) -> None:
        heapq.heappush(self._ready[task.stage.need().gpu_share > 0], (self._rank[task.key], task))

    def next(self, gpu: bool = True) -> Task | None:
        """Return a task to start, one for GPUs only if `gpu`; None while all others wait."""
        while queues := [
            queue for kind, queue in self._ready.items() if queue and (gpu or not kind)
        ]:
            _, task = heapq.heappop(min(queues, key=lambda queue: queue[0][0]))
            if task.key not in self.failed:
                return task
        return None

    def again(self, task: Task) -> None:
        """Hand out a task once more."""
        self._push(task)

    def finish(self, task: Task) -> None:
        """Note that a task has a result."""
        for dependent in self._dependents[task.key]:
            self._waiting[dependent.key] -= 1
            if self._waiting[dependent.key] == 0 and dependent.key not in self.failed:
                self._push(dependent)

    def fail(self, task: Task, failure: Failure) -> list[Task]:
        """Note that a task failed. Return it with all that cannot run without it."""
        failed: list[Task] = []
        reason = f"{task.stage.name} '{task.label}' failed: {failure.reason}"
        consequence = replace(failure, reason=reason, follows=True)
        queue = [task]
        for current in queue:
            if current.key in self.failed:
                continue
            self.failed[current.key] = failure if current is task else consequence
            failed.append(current)
            queue += self._dependents[current.key]
        return failed or [task]

"""Which task may run next."""

import heapq
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace

from sweeps.execution.failures import Failure
from sweeps.stages.task import Task

_Rank = tuple[int, int, int]
"""Trial, stage, place in the plan; the lowest goes first."""


class Schedule:
    """Hands out tasks whose inputs are there: trial by trial, and late stages first. So a sweep
    that is stopped has whole results of its first trials, not the trainings of all. Of `tasks` each
    comes after its inputs; the results of `done` keys are in the store."""

    def __init__(self, tasks: Sequence[Task], done: Collection[str]) -> None:
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
            if task.key in done:
                continue
            missing = [t for t in task.inputs if t.key not in done]
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
        """A task to start, of a GPU only if `gpu`; None while all that are left wait."""
        while queues := [
            queue for kind, queue in self._ready.items() if queue and (gpu or not kind)
        ]:
            _, task = heapq.heappop(min(queues, key=lambda queue: queue[0][0]))
            if task.key not in self.failed:
                return task
        return None

    def again(self, task: Task) -> None:
        self._push(task)

    def finish(self, task: Task) -> None:
        for dependent in self._dependents[task.key]:
            self._waiting[dependent.key] -= 1
            if self._waiting[dependent.key] == 0 and dependent.key not in self.failed:
                self._push(dependent)

    def fail(self, task: Task, failure: Failure) -> list[Task]:
        """Note that a task failed; returns it with all that cannot run without it."""
        fallen: list[Task] = []
        reason = f"{task.stage.name} '{task.label}' failed: {failure.reason}"
        because = replace(failure, reason=reason, follows=True)
        falling = [task]
        for current in falling:
            if current.key in self.failed:
                continue
            self.failed[current.key] = failure if current is task else because
            fallen.append(current)
            falling += self._dependents[current.key]
        return fallen or [task]

"""Run the tasks of a plan on a backend; results go to the store."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from sweeps.execution.backends import Backend, Job, WorkerDied
from sweeps.execution.failures import Failure
from sweeps.execution.schedule import Schedule
from sweeps.execution.worker import Ended, try_task
from sweeps.stages.stage import Need
from sweeps.stages.task import Task
from sweeps.stages.train import FinetuneStage
from sweeps.store.local import Store
from sweeps.store.result_folder import DamagedResult
from training.settings import LARGEST_BATCH


class Listener(Protocol):
    """Receives task events; all calls come from the driver."""

    def started(self, task: Task) -> None:
        """Receive a task that starts."""

    def finished(self, task: Task) -> None:
        """Receive a task whose result is stored."""

    def failed(self, task: Task, failure: Failure) -> None:
        """Receive a task without a result."""


@dataclass
class Outcome:
    """Failures and times of tasks, by key.

    `failures`: of tasks that had no result. `times`: when a task began and ended on its worker,
    seconds of the driver's `time.monotonic`."""

    failures: dict[str, Failure] = field(default_factory=dict)
    times: dict[str, tuple[float, float]] = field(default_factory=dict)


def execute(
    tasks: Sequence[Task],
    store: Store,
    backend: Backend,
    listener: Listener,
    outcome: Outcome | None = None,
    lasting_failures: Mapping[str, Failure] | None = None,
) -> Outcome:
    """Run all tasks, each after its inputs, that have no result in the store yet.

    If one fails, those that need its result fail, too; the others go on. A training for which a GPU
    is too small is tried again with half the batch, and the GPU to itself. `outcome` is of tasks
    that ran before: it is updated and returned. `lasting_failures`, of earlier runs and by key, are
    not tried again. Raises DamagedResult: a result that a task needs was damaged, and is removed;
    BackendLost: no task can end any more."""
    outcome = Outcome() if outcome is None else outcome
    cached = store.finished(tasks)
    for item in tasks:
        if item.key in cached and item.stage.resumable:  # it was stopped after its last step
            store.discard(item)
    failures = dict(lasting_failures or {})
    failures |= {key: failure for key, failure in outcome.failures.items() if failure.lasting}
    schedule = Schedule(tasks, cached)
    run = _Execution(store, backend, listener, outcome, schedule)
    for item in tasks:
        if item.key in failures and item.key not in cached | schedule.failed.keys():
            run.fail(item, failures[item.key])
    while True:
        run.hand_out()
        if not run.running:
            outcome.failures |= schedule.failed
            return outcome
        # None has ended: there may be more machines now.
        if (job := backend.wait(list(run.running))) is not None:
            run.take_back(job)


@dataclass
class _Execution:
    """Tasks between their schedule and the backend.

    `running`: jobs, with their tasks and needs. `halvings`: how often the batch of a training is
    halved, by its key."""

    store: Store
    backend: Backend
    listener: Listener
    outcome: Outcome
    schedule: Schedule
    running: dict[Job[Ended], tuple[Task, Need]] = field(default_factory=dict)
    halvings: Counter[str] = field(default_factory=Counter)

    def hand_out(self) -> None:
        """Start tasks while the backend takes some; without tasks it does not start."""
        while not self.running or len(self.running) < self.backend.slots:
            if (task := self.schedule.next(gpu=self._has_room())) is None:
                return
            if self.store.has(task):  # another driver was here in the meantime
                self._finish(task)
                continue
            need = task.stage.need(self.backend.gpus_per_training)
            if halvings := self.halvings[task.key]:
                need = replace(need, gpu_share=max(1.0, need.gpu_share))
            name, settings = f"{task.stage.name}: {task.label}", (halvings, need.gpu_share)
            job = self.backend.submit(try_task, task, self.store, *settings, name=name, need=need)
            self.running[job] = (task, need)
            self.listener.started(task)

    def take_back(self, job: Job[Ended]) -> None:
        """Note how a task ended. Raises DamagedResult: a result that it needs was damaged."""
        ended = _ended(job)
        task, _ = self.running.pop(job)
        now, failure = time.monotonic(), ended.failure
        self.outcome.times[task.key] = (now - ended.seconds, now)
        if failure is None:
            self.outcome.failures.pop(task.key, None)  # of a rung before
            self._finish(task)
        elif failure.damaged or not all(map(self.store.has, task.inputs)):
            raise DamagedResult(failure.reason)
        elif failure.out_of_gpu_memory and _can_be_halved(task, self.halvings[task.key]):
            self.halvings[task.key] += 1
            self.schedule.again(task)
        else:
            self.fail(task, failure)

    def fail(self, failed: Task, failure: Failure) -> None:
        for fallen in self.schedule.fail(failed, failure):
            self.listener.failed(fallen, self.schedule.failed.get(fallen.key, failure))

    def _finish(self, task: Task) -> None:
        self.schedule.finish(task)
        self.listener.finished(task)

    def _has_room(self) -> bool:
        """Whether a task that needs GPUs or memory would start: else it would block CPUs."""
        if not self.running:
            return True
        needs, room = [need for _, need in self.running.values()], self.backend.room
        return (
            sum(need.gpu_share for need in needs) < room.gpus
            and sum(need.memory for need in needs) < room.memory
        )


def _ended(job: Job[Ended]) -> Ended:
    try:
        return job.result()
    except WorkerDied as error:
        return Ended(Failure(str(error), str(error.__cause__)), 0.0)
    except OSError as error:
        return Ended(Failure.of(error), 0.0)


def _can_be_halved(task: Task, halvings: int) -> bool:
    """Whether a training that was too large for a GPU had more than one frame in a step."""
    if not isinstance(task.stage, FinetuneStage):
        return False
    size = task.stage.training.batch_size
    return (LARGEST_BATCH if size == "auto" else size) >> halvings > 1

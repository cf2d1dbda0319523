"""Run the tasks of a plan, on Ray or in this process; results go to the store."""

from __future__ import annotations

import os
import shutil
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from sweeps.config import RaySettings
from sweeps.schedule import Schedule
from sweeps.stages import FUNCTIONS
from sweeps.store import Store
from sweeps.task import Task

# One thread a task: Ray runs as many tasks as there are CPUs.
_THREADS = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class Listener(Protocol):
    """Is told what happens; all calls come from the driver."""

    def started(self, task: Task) -> None: ...
    def finished(self, task: Task) -> None: ...
    def failed(self, task: Task, reason: str, log: str) -> None: ...


class Backend(Protocol):
    """Where tasks run."""

    @property
    def slots(self) -> int:
        """Tasks that can run at once."""

    def submit(self, task: Task) -> Any:
        """Start a task. Returns a token for `wait`."""

    def wait(self, tokens: Sequence[Any]) -> tuple[Any, tuple[str, str] | None]:
        """One token whose task has ended, and (reason, traceback) if it failed."""

    def cancel(self, tokens: Sequence[Any]) -> None:
        """Stop the tasks."""


def execute(
    tasks: Sequence[Task], store: Store, backend: Backend, listener: Listener
) -> dict[str, str]:
    """Run all tasks that have no result in the store yet.

    A task that fails takes down those that need its result; the others go on.

    Returns:
        Reasons by key of the tasks that failed or could not run.
    """
    done = {task.key for task in tasks if store.has(task)}
    for item in tasks:
        if item.key in done and item.resumable:  # it was stopped after its last step
            shutil.rmtree(store.unfinished(item), ignore_errors=True)
    schedule = Schedule(tasks, done)
    running: dict[Any, Task] = {}
    try:
        while True:
            while len(running) < backend.slots and (task := schedule.next()):
                listener.started(task)
                running[backend.submit(task)] = task
            if not running:
                return schedule.failed
            token, failure = backend.wait(list(running))
            task = running.pop(token)
            if failure is None:
                schedule.finish(task)
                listener.finished(task)
            else:
                for fallen in schedule.fail(task, failure[0]):
                    listener.failed(fallen, schedule.failed[fallen.key], failure[1])
    except BaseException:
        backend.cancel(list(running))
        raise


def run_task(task: Task, store: Store) -> None:
    """Compute one result from those in the store, and store it.

    Inputs are mapped from the store's files, not sent: workers on one machine share the pages, and
    clouds larger than the memory can be trained on.
    """
    inputs = [store.load(needed) for needed in task.inputs]
    unfinished = store.unfinished(task)
    start = time.perf_counter()
    value = FUNCTIONS[task.stage](
        task.params, *inputs, **({"folder": unfinished} if task.resumable else {})
    )
    earlier = value.get("earlier_seconds", 0.0)  # before a stop
    store.save(task, value, earlier + time.perf_counter() - start)
    shutil.rmtree(unfinished, ignore_errors=True)


def reason_of(error: BaseException) -> str:
    """One line that says what went wrong."""
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) else f"{type(error).__name__}: {text}"


@dataclass
class InProcess:
    """Runs every task at once in this process: `ray: debug`, for a debugger."""

    store: Store
    slots: int = 1

    def submit(self, task: Task) -> Any:
        try:
            run_task(task, self.store)
        except Exception as error:
            return task.key, (reason_of(error), traceback.format_exc())
        return task.key, None

    def wait(self, tokens: Sequence[Any]) -> tuple[Any, tuple[str, str] | None]:
        return tokens[0], tokens[0][1]

    def cancel(self, tokens: Sequence[Any]) -> None:
        """Nothing runs between two calls."""


class OnRay:
    """Runs tasks as Ray tasks."""

    def __init__(self, store: Store, settings: RaySettings) -> None:
        import ray

        self._ray = ray
        self._store = store
        resources = ray.cluster_resources()
        self.slots = max(1, int(resources.get("CPU", 1)))
        self._gpus = settings.gpus_per_training if resources.get("GPU", 0) else 0.0
        self._run: Any = ray.remote(num_cpus=1)(_run_remotely)

    def submit(self, task: Task) -> Any:
        run = self._run.options(
            name=f"{task.stage}: {task.label}", num_gpus=self._gpus if task.gpu else 0
        )
        return run.remote(task, self._store)

    def wait(self, tokens: Sequence[Any]) -> tuple[Any, tuple[str, str] | None]:
        (token,), _ = self._ray.wait(list(tokens), num_returns=1)
        try:
            return token, self._ray.get(token)
        except self._ray.exceptions.RayError as error:  # the worker died
            return token, (f"the worker died: {reason_of(error)}", str(error))

    def cancel(self, tokens: Sequence[Any]) -> None:
        for token in tokens:
            self._ray.cancel(token, force=True)


def _run_remotely(task: Task, store: Store) -> tuple[str, str] | None:
    """`run_task` in a worker. A mistake comes back as a note, not as Ray's nested traceback."""
    import torch  # imported here to set its threads before anything uses them

    torch.set_num_threads(1)
    try:
        run_task(task, store)
    except Exception as error:
        return reason_of(error), traceback.format_exc()
    return None


@contextmanager
def backend_for(settings: RaySettings, store: Store) -> Iterator[Backend]:
    """The backend that `ray:` asks for, shut down at the end."""
    if settings.address == "debug":
        yield InProcess(store)
        return
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray

    local = settings.address == "local"
    options: dict[str, Any] = (
        {
            "num_cpus": settings.num_cpus,
            "num_gpus": settings.num_gpus,
            "include_dashboard": False,
            "_node_ip_address": "127.0.0.1",  # this machine alone
        }
        if local
        else {}
    )
    paths = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    ray.init(
        address=settings.address,
        log_to_driver=False,
        logging_level="ERROR",
        runtime_env={"env_vars": {**_THREADS, "PYTHONPATH": os.pathsep.join(paths)}},
        **options,
    )
    try:
        yield OnRay(store, settings)
    finally:
        ray.shutdown()

"""Run the tasks of a plan, on Ray or in this process; results go to the store."""

from __future__ import annotations

import os
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
from sweeps.store import Store, Value
from sweeps.task import Task

# One thread a task: Ray runs as many tasks as there are CPUs.
_THREADS = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class Listener(Protocol):
    """Is told what happens; all calls come from the driver."""

    def started(self, task: Task) -> None: ...
    def finished(self, task: Task) -> None: ...
    def failed(self, task: Task, reason: str, log: str) -> None: ...


class Backend(Protocol):
    """Where tasks run. A handle stands for a result that may be elsewhere."""

    @property
    def slots(self) -> int:
        """Tasks that can run at once."""

    def submit(self, task: Task, inputs: Sequence[Any]) -> tuple[Any, Any]:
        """Start a task. Returns the result's handle and a token for `wait`."""

    def load(self, task: Task) -> Any:
        """Handle of a result that is in the store."""

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
    schedule = Schedule(tasks, {task.key for task in tasks if store.has(task)})
    handles: dict[str, Any] = {}
    running: dict[Any, Task] = {}
    try:
        while True:
            while len(running) < backend.slots and (task := schedule.next()):
                for needed in task.inputs:
                    if needed.key not in handles:
                        handles[needed.key] = backend.load(needed)
                listener.started(task)
                handle, token = backend.submit(task, [handles[t.key] for t in task.inputs])
                handles[task.key] = handle
                running[token] = task
            if not running:
                return schedule.failed
            token, failure = backend.wait(list(running))
            task = running.pop(token)
            if failure is None:
                unused = schedule.finish(task)
                listener.finished(task)
            else:
                fallen, unused = schedule.fail(task, failure[0])
                for other in fallen:
                    listener.failed(other, schedule.failed[other.key], failure[1])
            for key in unused:
                handles.pop(key, None)  # the last reference: frees the object store
    except BaseException:
        backend.cancel(list(running))
        raise


def run_task(task: Task, store: Store, *inputs: Value) -> Value:
    """Compute one result and store it."""
    start = time.perf_counter()
    value = FUNCTIONS[task.stage](task.params, *inputs)
    store.save(task, value, time.perf_counter() - start)
    return value


def reason_of(error: BaseException) -> str:
    """One line that says what went wrong."""
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) else f"{type(error).__name__}: {text}"


@dataclass
class InProcess:
    """Runs every task at once in this process: `ray: debug`, for a debugger."""

    store: Store
    slots: int = 1

    def submit(self, task: Task, inputs: Sequence[Any]) -> tuple[Any, Any]:
        try:
            return run_task(task, self.store, *inputs), (task.key, None)
        except Exception as error:
            return None, (task.key, (reason_of(error), traceback.format_exc()))

    def load(self, task: Task) -> Any:
        return self.store.load(task)

    def wait(self, tokens: Sequence[Any]) -> tuple[Any, tuple[str, str] | None]:
        return tokens[0], tokens[0][1]

    def cancel(self, tokens: Sequence[Any]) -> None:
        """Nothing runs between two calls."""


class OnRay:
    """Runs tasks as Ray tasks; results travel through the object store."""

    def __init__(self, store: Store, settings: RaySettings) -> None:
        import ray

        self._ray = ray
        self._store = store
        resources = ray.cluster_resources()
        self.slots = max(1, int(resources.get("CPU", 1)))
        self._gpus = settings.gpus_per_training if resources.get("GPU", 0) else 0.0
        # Two results: the driver fetches the short note and leaves the value where it is.
        self._run: Any = ray.remote(num_cpus=1, num_returns=2)(_run_remotely)
        self._fetch: Any = ray.remote(num_cpus=0)(_load_remotely)

    def submit(self, task: Task, inputs: Sequence[Any]) -> tuple[Any, Any]:
        run = self._run.options(
            name=f"{task.stage}: {task.label}", num_gpus=self._gpus if task.gpu else 0
        )
        # The inputs' own inputs stay behind: a worker needs to know this task alone.
        value, note = run.remote(task, self._store, *inputs)
        return value, note

    def load(self, task: Task) -> Any:
        return self._fetch.remote(task, self._store)

    def wait(self, tokens: Sequence[Any]) -> tuple[Any, tuple[str, str] | None]:
        (token,), _ = self._ray.wait(list(tokens), num_returns=1)
        try:
            return token, self._ray.get(token)
        except self._ray.exceptions.RayError as error:  # the worker died
            return token, (f"the worker died: {reason_of(error)}", str(error))

    def cancel(self, tokens: Sequence[Any]) -> None:
        for token in tokens:
            self._ray.cancel(token, force=True)


def _run_remotely(task: Task, store: Store, *inputs: Value) -> tuple[Any, tuple[str, str] | None]:
    """`run_task` in a worker. A mistake comes back as a note, not as Ray's nested traceback."""
    import torch  # imported here to set its threads before anything uses them

    torch.set_num_threads(1)
    try:
        return run_task(task, store, *inputs), None
    except Exception as error:
        return None, (reason_of(error), traceback.format_exc())


def _load_remotely(task: Task, store: Store) -> Value:
    return store.load(task)


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

"""Where tasks run: on Ray, or in this process."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

from sweeps.configuration.sweep import RaySettings
from sweeps.execution.failures import Failure
from sweeps.execution.needs import Need
from sweeps.execution.worker import Batch, Ended, try_task
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task

_LOOK_S = 2.0
"""How often the driver looks whether machines came or went."""


class BackendLost(RuntimeError):
    """There is nothing left to run tasks on."""


@dataclass(frozen=True)
class Room:
    """What the machines have for trainings together: GPUs, and memory in bytes."""

    gpus: float = math.inf
    memory: float = math.inf


class Backend(Protocol):
    """Where tasks run."""

    @property
    def probes(self) -> bool:
        """Whether the needs of trainings matter."""

    @property
    def gpus_per_training(self) -> float | Literal["auto"]:
        """Share of a GPU that a training gets."""

    @property
    def slots(self) -> int:
        """Tasks to hand out at once."""

    @property
    def room(self) -> Room:
        """What trainings share."""

    @property
    def device(self) -> str:
        """What trainings run on."""

    @property
    def cores(self) -> int:
        """Tasks that run at once."""

    def submit(self, task: Task, how: Batch, need: Need) -> Any:
        """Start a task. Returns a token for `wait`."""

    def wait(self, tokens: Sequence[Any]) -> tuple[Any, Ended] | None:
        """A token whose task has ended, and how; None if none has for a while.

        Raises:
            BackendLost: no task can end any more.
        """

    def cancel(self, tokens: Sequence[Any]) -> None:
        """Stop the tasks."""


@dataclass
class InProcess:
    """Runs every task at once in this process: `ray: debug`, for a debugger."""

    store: AnyStore
    slots: ClassVar[int] = 1
    room: ClassVar[Room] = Room()
    device: ClassVar[str] = "this process"
    cores: ClassVar[int] = 1
    probes: ClassVar[bool] = False
    gpus_per_training: ClassVar[float | Literal["auto"]] = 1.0

    def submit(self, task: Task, how: Batch, need: Need) -> Any:
        return task.key, try_task(task, self.store, how)

    def wait(self, tokens: Sequence[Any]) -> tuple[Any, Ended] | None:
        return tokens[0], tokens[0][1]

    def cancel(self, tokens: Sequence[Any]) -> None:
        """Nothing runs between two calls."""


class OnRay:
    """Runs tasks as Ray tasks, one CPU each. Ray tries again what a dying machine took down."""

    probes = True

    def __init__(self, ray: Any, store: AnyStore, settings: RaySettings) -> None:
        self.ray = ray
        self._store = store
        self.gpus_per_training = settings.gpus_per_training
        self._looked = float("-inf")
        self._run: Any = ray.remote(num_cpus=1, max_retries=3)(_run_remotely)

    @property
    def cores(self) -> int:
        self._look()
        return max(1, int(self._resources.get("CPU", 1)))

    @property
    def slots(self) -> int:
        return self.cores + 1  # one more waits at Ray's door: no core idles while the driver thinks

    @property
    def room(self) -> Room:
        self._look()
        return Room(self._resources.get("GPU", 0) or math.inf, self._resources.get("memory", 0))

    @property
    def device(self) -> str:
        self._look()
        if not self._resources.get("GPU", 0):
            return "CPU"
        # Ray names the kinds of accelerators as resources.
        return ", ".join(sorted(n for n in self._resources if n.startswith("accelerator_type:")))

    def submit(self, task: Task, how: Batch, need: Need) -> Any:
        self._look()
        run = self._run.options(
            name=f"{task.stage}: {task.label}",
            num_gpus=need.gpu_share if self._resources.get("GPU", 0) else 0,
            # What no machine has would wait for ever: it gets the largest machine to itself.
            memory=min(need.memory, self._largest_memory),
        )
        return run.remote(task, self._store, how, str(Path.cwd()))

    def wait(self, tokens: Sequence[Any]) -> tuple[Any, Ended] | None:
        token = None
        try:
            ended, _ = self.ray.wait(list(tokens), num_returns=1, timeout=_LOOK_S)
            if not ended:
                return None
            (token,) = ended
            return token, self.ray.get(token)
        except self.ray.exceptions.LocalRayletDiedError:
            raise BackendLost("Ray's node on this machine died") from None
        except ConnectionError as error:
            raise BackendLost(f"the Ray cluster is gone: {error}") from None
        except self.ray.exceptions.RayError as error:  # the worker died, more than once
            reason = f"the worker died: {Failure.of(error).reason}"
            return token, Ended(Failure(reason, str(error)), 0.0)

    def cancel(self, tokens: Sequence[Any]) -> None:
        for token in tokens:
            self.ray.cancel(token, force=True)

    def _look(self) -> None:
        """Ask Ray what there is, now and then: machines come and go."""
        now = time.monotonic()
        if now - self._looked > _LOOK_S:
            self._looked = now
            alive = [node["Resources"] for node in self.ray.nodes() if node["Alive"]]
            self._resources: Counter[str] = Counter()
            for node in alive:
                self._resources.update(node)
            self._largest_memory = max((int(node.get("memory", 0)) for node in alive), default=0)


def _run_remotely(task: Task, store: AnyStore, how: Batch, folder: str) -> Ended:
    """`try_task` in a worker."""
    import torch  # imported here to set its threads before anything uses them

    from sweeps.execution.ray_cluster import enter_folder

    torch.set_num_threads(1)
    try:
        enter_folder(folder)
    except OSError as error:
        return Ended(Failure.of(error), 0.0)
    return try_task(task, store, how)


@contextmanager
def backend_for(settings: RaySettings, store: AnyStore) -> Iterator[Backend]:
    """The backend that `ray:` asks for, shut down at the end."""
    if settings.address == "debug":
        yield InProcess(store)
        return
    from sweeps.execution.ray_cluster import ray_session

    with ray_session(settings) as ray:
        yield OnRay(ray, store, settings)

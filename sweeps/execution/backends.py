"""Backends that run calls: Ray, or this process."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import or_
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from sweeps.configuration.sweep import RaySettings
from sweeps.execution.failures import Failure
from sweeps.stages.stage import Need

T = TypeVar("T")

_LOOK_S = 2.0
"""How often the driver looks whether machines came or went."""


class BackendLost(RuntimeError):
    """There is nothing left to run calls on."""


class WorkerDied(BackendLost):
    """The worker that ran a call died, more than once."""


@dataclass(frozen=True)
class Room:
    """Resources of all machines together for trainings: GPUs, and memory in bytes."""

    gpus: float = math.inf
    memory: float = math.inf


@dataclass(frozen=True, eq=False)
class Later(Generic[T]):
    """A call in this process, which runs when its result is read."""

    function: Callable[..., T]
    arguments: Sequence[Any]

    def result(self) -> T:
        """Return the result of the call once it has ended, or raise its error.

        Raises WorkerDied: there is no result; BackendLost: no call can end any more."""
        return self.function(*self.arguments)


class InProcess:
    """Backend that runs one call after the other in this process: `ray: debug`, for a debugger.

    Attributes:
        gpus_per_training: share of a GPU that a training gets.
        slots: calls to hand out at once.
        room: resources that trainings share.
        cores: calls that run at once."""

    slots = cores = 1
    room = Room()
    gpus_per_training = 1.0

    def share(self, value: T) -> T:
        """Return `value` as an argument of many calls, of which each machine gets one copy."""
        return value

    def submit(
        self, function: Callable[..., T], *arguments: Any, name: str = "", need: Need = Need()
    ) -> Later[T]:
        """Start a call of a function of a module; `name` names it for people."""
        return Later(function, arguments)

    def wait(self, jobs: Sequence[Any]) -> Any:
        """Return a job that has ended; None if none has for a while. Raises BackendLost."""
        return jobs[0]


@dataclass(frozen=True, eq=False)
class RayJob(Generic[T]):
    """A Ray task."""

    ray: Any
    reference: Any

    def result(self) -> T:
        with _translated(self.ray):
            value: T = self.ray.get(self.reference)
            return value


class OnRay:
    """Backend that runs calls as Ray tasks; attributes as of `InProcess`.

    Ray retries calls that a dying machine ran, and machines may come and go. `start` returns Ray,
    initialised, when machines are first needed."""

    def __init__(self, start: Callable[[], Any], settings: RaySettings) -> None:
        self._start = start
        self.gpus_per_training = settings.gpus_per_training
        self._looked = float("-inf")

    @cached_property
    def _ray(self) -> Any:
        return self._start()

    @cached_property
    def _run(self) -> Any:
        return self._ray.remote(num_cpus=1, max_retries=3)(_call)

    @property
    def cores(self) -> int:
        self._look()
        return max(1, int(self._resources.get("CPU", 1)))

    @property
    def slots(self) -> int:
        return self.cores + 1  # one more is queued by Ray: no core idles while the driver thinks

    @property
    def room(self) -> Room:
        self._look()
        return Room(self._resources.get("GPU", 0) or math.inf, self._resources.get("memory", 0))

    def share(self, value: T) -> T:
        shared: T = self._ray.put(value)  # Ray replaces the reference by the value
        return shared

    def submit(
        self, function: Callable[..., T], *arguments: Any, name: str = "", need: Need = Need()
    ) -> RayJob[T]:
        self._look()
        run = self._run.options(
            name=name,
            # A call that needs more than any machine has would wait for ever: it gets the largest.
            num_cpus=min(need.cpus, int(self._largest["CPU"])),
            num_gpus=min(need.gpu_share, self._largest["GPU"]),
            memory=min(need.memory, int(self._largest["memory"])),
        )
        return RayJob(self._ray, run.remote(str(Path.cwd()), function, *arguments))

    def wait(self, jobs: Sequence[Any]) -> Any:
        by_reference = {job.reference: job for job in jobs}
        with _translated(self._ray):
            ended, _ = self._ray.wait(list(by_reference), num_returns=1, timeout=_LOOK_S)
        return by_reference[ended[0]] if ended else None

    def _look(self) -> None:
        """Update the resources of Ray now and then, as machines come and go."""
        now = time.monotonic()
        if now - self._looked > _LOOK_S:
            self._looked = now
            alive = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
            self._resources: Counter[str] = Counter()
            for node in alive:
                self._resources.update(node)
            self._largest = reduce(or_, map(Counter, alive), Counter({"CPU": 1}))


def _call(folder: str, function: Callable[..., T], *arguments: Any) -> T:
    from sweeps.execution.ray_cluster import enter_folder

    enter_folder(folder)
    return function(*arguments)


@contextmanager
def _translated(ray: Any) -> Iterator[None]:
    """Raise errors of Ray as those of `Later.result`."""
    try:
        yield
    except ray.exceptions.RayTaskError as error:
        raise error.cause from error
    except ray.exceptions.LocalRayletDiedError:
        raise BackendLost("Ray's node on this machine died") from None
    except ConnectionError as error:
        raise BackendLost(f"the Ray cluster is gone: {error}") from None
    except ray.exceptions.RayError as error:
        raise WorkerDied(f"the worker died: {Failure.of(error).reason}") from error


Backend: TypeAlias = InProcess | OnRay
Job = Later[T] | RayJob[T]


@contextmanager
def backend_for(settings: RaySettings) -> Iterator[Backend]:
    """Return the backend that `ray:` names, shut down at the end with all calls that still run.

    Errors of `ray_session` come from its first use."""
    from sweeps.execution.ray_cluster import ray_session, set_variables

    if settings.address == "debug":
        with set_variables({"CUDA_VISIBLE_DEVICES": ""} if settings.num_gpus == 0 else {}):
            yield InProcess()
        return
    with ExitStack() as stack:
        yield OnRay(lambda: stack.enter_context(ray_session(settings)), settings)

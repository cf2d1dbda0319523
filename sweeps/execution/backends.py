"""Where calls run: on Ray, or in this process."""

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
    """What ran a call died, more than once."""


@dataclass(frozen=True)
class Room:
    """What the machines have for trainings together: GPUs, and memory in bytes."""

    gpus: float = math.inf
    memory: float = math.inf


@dataclass(frozen=True, eq=False)
class Later(Generic[T]):
    """A call in this process, made when its result is asked for."""

    function: Callable[..., T]
    arguments: Sequence[Any]

    def result(self) -> T:
        """What the call returned, once it has ended. What it raised is raised; and WorkerDied:
        there is no result, BackendLost: no call can end any more."""
        return self.function(*self.arguments)


class InProcess:
    """Runs one call after the other in this process: `ray: debug`, for a debugger. A backend has a
    share of a GPU that a training gets, calls to hand out at once, what trainings share, and calls
    that run at once."""

    slots = cores = 1
    room = Room()
    gpus_per_training = 1.0

    def share(self, value: T) -> T:
        """`value` as an argument of many calls: each machine gets it once."""
        return value

    def submit(
        self, function: Callable[..., T], *arguments: Any, name: str = "", need: Need = Need()
    ) -> Later[T]:
        """Start a call of a function of a module, which a person calls `name`."""
        return Later(function, arguments)

    def wait(self, jobs: Sequence[Any]) -> Any:
        """A job that has ended; None if none has for a while. Raises BackendLost."""
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
    """As `InProcess`, as Ray tasks. Ray tries again what a dying machine took down, and machines
    may come and go. `start` gives Ray, initialised, when machines are first asked for."""

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
        return self.cores + 1  # one more waits at Ray's door: no core idles while the driver thinks

    @property
    def room(self) -> Room:
        self._look()
        return Room(self._resources.get("GPU", 0) or math.inf, self._resources.get("memory", 0))

    def share(self, value: T) -> T:
        shared: T = self._ray.put(value)  # Ray puts the value in the place of its reference
        return shared

    def submit(
        self, function: Callable[..., T], *arguments: Any, name: str = "", need: Need = Need()
    ) -> RayJob[T]:
        self._look()
        run = self._run.options(
            name=name,
            # What no machine has would wait for ever: it gets the largest machine to itself.
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
        """Ask Ray what there is, now and then: machines come and go."""
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
    """Ray's errors as those of `Later.result`."""
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
    """The backend that `ray:` asks for, shut down at the end with all calls that still run. What
    `ray_session` raises comes from the first use."""
    if settings.address == "debug":
        yield InProcess()
        return
    from sweeps.execution.ray_cluster import ray_session

    with ExitStack() as stack:
        yield OnRay(lambda: stack.enter_context(ray_session(settings)), settings)

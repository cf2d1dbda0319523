"""Where rigs are assessed: by Ray's workers, which keep the POG, or in this process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from cachetools import LRUCache, cached

from lidarplace import OccupancyGrid
from sweeps.execution.backends import Backend, BackendLost
from sweeps.execution.backends import OnRay as RayBackend
from sweeps.execution.failures import Failure
from sweeps.search.problem.assess import Assessment, Question, assess
from sweeps.search.problem.rig import Rig


class Pool(Protocol):
    """Assesses rigs on one POG."""

    def submit(self, rig: Rig, question: Question) -> Any:
        """Start with a rig. Returns a token for `result`."""

    def result(self, token: Any) -> Assessment:
        """What was found of the rig."""


class InProcess:
    """Assesses in this process, when the result is asked for."""

    def __init__(self, grids: Mapping[str, OccupancyGrid]) -> None:
        self._grids = grids

    def submit(self, rig: Rig, question: Question) -> Any:
        return rig, question

    def result(self, token: Any) -> Assessment:
        rig, question = token
        return assess(rig, question, self._grids)


class OnRay:
    """Assesses in Ray tasks, one CPU each. Workers keep the grids, which Ray shares out once; Ray
    tries again what a dying machine took down, and machines may come and go."""

    def __init__(self, ray: Any, grids: Mapping[str, OccupancyGrid]) -> None:
        for grid in grids.values():
            grid.levels, grid.h_pog  # noqa: B018 - worked out once, not by every worker
        self._ray = ray
        self._shared = [ray.put(dict(grids))]  # in a list: tasks get the reference itself
        self._assess = ray.remote(num_cpus=1, max_retries=3)(_assess)

    def submit(self, rig: Rig, question: Question) -> Any:
        return self._assess.remote(rig, question, self._shared, str(Path.cwd()))

    def result(self, token: Any) -> Assessment:
        try:
            return self._ray.get(token)
        except self._ray.exceptions.RayTaskError:
            raise  # a mistake of ours
        except self._ray.exceptions.RayError as error:  # the worker died, more than once
            raise BackendLost(f"a worker died: {Failure.of(error).reason}") from None


def _assess(rig: Rig, question: Question, shared: list[Any], folder: str) -> Assessment:
    """`assess` in a worker."""
    from sweeps.execution.ray_cluster import enter_folder

    enter_folder(folder)
    return assess(rig, question, _grids(shared[0]))


@cached(LRUCache(maxsize=1), key=lambda reference: reference.hex())
def _grids(reference: Any) -> dict[str, OccupancyGrid]:
    """The grids behind a reference; those of the last one are kept."""
    import ray

    return ray.get(reference)


def pool_for(backend: Backend, grids: Mapping[str, OccupancyGrid]) -> Pool:
    """Workers where the tasks of a sweep would run."""
    return OnRay(backend.ray, grids) if isinstance(backend, RayBackend) else InProcess(grids)


def in_order(pool: Pool, rigs: Sequence[Rig], question: Question) -> list[Assessment]:
    """Assess several rigs at once; results in the order of `rigs`."""
    tokens = [pool.submit(rig, question) for rig in rigs]
    return [pool.result(token) for token in tokens]

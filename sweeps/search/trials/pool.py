"""Rigs assessed on one POG, where the tasks of a sweep would run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lidarplace import OccupancyGrid
from sweeps.execution.backends import Backend, Job
from sweeps.search.problem.assess import Assessment, Question, assess
from sweeps.search.problem.choice import Choices


@dataclass(frozen=True)
class Pool:
    """Assesses rigs on one POG.

    Attributes:
        grids: POG by class, shared out by the backend.
    """

    backend: Backend
    grids: Mapping[str, OccupancyGrid]

    @classmethod
    def of(cls, backend: Backend, grids: Mapping[str, OccupancyGrid]) -> Pool:
        """The pool of a backend's workers."""
        for grid in grids.values():
            grid.levels, grid.h_pog  # noqa: B018 - worked out once, not by every worker
        return cls(backend, backend.share(dict(grids)))

    def submit(self, rig: Choices, question: Question) -> Job[Assessment]:
        """Start with a rig."""
        return self.backend.submit(assess, rig, question, self.grids)

    def in_order(self, rigs: Sequence[Choices], question: Question) -> list[Assessment]:
        """Assess several rigs at once; results in the order of `rigs`."""
        jobs = [self.submit(rig, question) for rig in rigs]
        return [job.result() for job in jobs]

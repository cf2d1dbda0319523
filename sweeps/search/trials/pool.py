"""Rigs assessed on one training traffic, where the tasks of a sweep would run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sweeps.execution.backends import Backend, Job
from sweeps.search.problem.assess import Assessment, Question, assess
from sweeps.search.problem.choice import Choices
from sweeps.search.problem.traffic import Traffic


@dataclass(frozen=True)
class Pool:
    """Assesses rigs on one traffic.

    Attributes:
        traffic: shared out by the backend.
    """

    backend: Backend
    traffic: Traffic

    @classmethod
    def of(cls, backend: Backend, traffic: Traffic) -> Pool:
        """The pool of a backend's workers."""
        for grid in traffic.grids.values():
            grid.levels, grid.h_pog  # noqa: B018 - worked out once, not by every worker
        if traffic.objects is not None:
            traffic.objects.objects.frames  # noqa: B018 - as well
        return cls(backend, backend.share(traffic))

    def submit(self, rig: Choices, question: Question) -> Job[Assessment]:
        """Start with a rig."""
        return self.backend.submit(assess, rig, question, self.traffic)

    def in_order(self, rigs: Sequence[Choices], question: Question) -> list[Assessment]:
        """Assess several rigs at once; results in the order of `rigs`."""
        jobs = [self.submit(rig, question) for rig in rigs]
        return [job.result() for job in jobs]

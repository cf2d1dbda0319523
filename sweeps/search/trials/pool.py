"""Rigs assessed on one training traffic: by a pool of workers, and candidates by surrogates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import optuna

from sweeps.execution.backends import Backend, Job
from sweeps.search.problem.assess import Assessment, Question, Traffic, assess
from sweeps.search.problem.choice import Choices
from sweeps.search.problem.space import Space
from sweeps.search.trials.study import Candidate, assessment_of, candidate_of, finished_trials, tell


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


class SurrogateAnswers:
    """Answers by a pool of workers."""

    def __init__(self, study: optuna.Study, space: Space, question: Question, pool: Pool) -> None:
        self._study, self._question, self._pool = study, question, pool
        self._known: dict[tuple[Any, ...], Assessment] = {
            candidate_of(trial, space).key: assessment_of(trial) for trial in finished_trials(study)
        }
        self._asked: list[tuple[optuna.Trial, Candidate]] = []
        self._jobs: dict[tuple[Any, ...], Job[Assessment]] = {}

    def begin(self, trial: optuna.Trial, candidate: Candidate) -> None:
        self._asked.append((trial, candidate))
        if candidate.key not in self._known and candidate.key not in self._jobs:
            self._jobs[candidate.key] = self._pool.submit(candidate.rig, self._question)

    def finish(self) -> None:
        for key, job in self._jobs.items():
            self._known[key] = job.result()
        for trial, candidate in self._asked:
            found = self._known[candidate.key]
            values, failure = None, None
            if found.values is not None:
                values = [found.values[o.name] for o in self._question.objectives]
                if any(math.isnan(value) for value in values):
                    failure = "an objective is undefined for this rig: nothing is covered"
            tell(self._study, trial, found, values, failure)
        self._asked, self._jobs = [], {}

"""Candidates assessed by surrogates: nothing is evaluated twice."""

import math
from typing import Any

import optuna

from sweeps.execution.backends import Job
from sweeps.search.problem.assess import Assessment, Question
from sweeps.search.problem.space import Space
from sweeps.search.trials.pool import Pool
from sweeps.search.trials.study import Candidate, assessment_of, candidate_of, finished_trials, tell


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

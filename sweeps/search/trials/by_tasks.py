"""Candidates assessed by detections: what answers by training and by a generalist share."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar

import optuna

from sweeps.execution.backends import Backend
from sweeps.execution.execute import Listener, Outcome, execute
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.study import Candidate, tell
from sweeps.search.trials.traffic import Pool
from sweeps.store.open import AnyStore, reference
from sweeps.tasks.task import Task

Asked = Sequence[tuple[optuna.Trial, Candidate]]
Measured = tuple[dict[int, list[float]], dict[int, str]]
"""Values of the measured objectives, and reasons why there are none, by number of the trial."""


class TaskAnswers(ABC):
    """Answers by tasks. Rigs that violate a constraint are not measured.

    Results stay in the store, so a stop loses nothing.

    Args:
        pool: evaluates constraints and prices.
        listener: receives task events.
    """

    purpose: ClassVar[str]
    """Names the reference to the results in the store."""

    def __init__(
        self,
        study: optuna.Study,
        problem: Problem,
        pool: Pool,
        store: AnyStore,
        backend: Backend,
        listener: Listener,
    ) -> None:
        self.study, self.problem, self._pool = study, problem, pool
        self.store, self.backend, self._listener = store, backend, listener
        self._asked: list[tuple[optuna.Trial, Candidate]] = []
        self._reference = reference(problem.sweep(), self.purpose)
        self._referred = set(store.references().get(self._reference, ()))

    def begin(self, trial: optuna.Trial, candidate: Candidate) -> None:
        """Take up a candidate."""
        self._asked.append((trial, candidate))

    def finish(self) -> None:
        """Measure what was taken up, and report it to the study."""
        asked, self._asked = self._asked, []
        found = self._pool.in_order([c.rig for _, c in asked], self.problem.question)
        answers = list(zip(asked, found, strict=True))
        feasible = [own for own, assessment in answers if assessment.feasible]
        values, failed = self.measure(feasible) if feasible else ({}, {})
        for (trial, candidate), assessment in answers:
            whole = None
            if candidate.number in values:
                assert assessment.values is not None
                left = iter(values[candidate.number])
                whole = [
                    next(left) if o.measured else assessment.values[o.name]
                    for o in self.problem.file.search.objective
                ]
            tell(self.study, trial, assessment, whole, failed.get(candidate.number))

    @abstractmethod
    def measure(self, asked: Asked) -> Measured:
        """Measure feasible candidates; one that is in neither mapping is pruned."""

    def execute(self, tasks: Iterable[Task]) -> Outcome:
        """Run tasks, to whose results the search refers from now on."""
        tasks = list(tasks)
        self._referred |= {task.key for task in tasks}
        self.store.refer(self._reference, self._referred)
        return execute(tasks, self.store, self.backend, self._listener)

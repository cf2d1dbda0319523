"""The rigs that a search found, compared exactly with the paper's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import optuna
from optuna.trial import FrozenTrial

from sweeps.search.assess import Assessment, Question
from sweeps.search.pool import Pool, in_order
from sweeps.search.rig import Rig
from sweeps.search.settings import ObjectiveSettings
from sweeps.search.space import Space
from sweeps.search.study import assessment_of, candidate_of, finished_trials

MOST_EXACT = 20
"""Best rigs that are assessed again with all rays."""


@dataclass(frozen=True)
class Judged:
    """A rig and what was found of it, with all rays.

    Attributes:
        rig, assessment: there.
        role: found, greedy or paper.
        trial: number of the trial that found it; None if none did.
    """

    rig: Rig
    assessment: Assessment
    role: str
    trial: int | None = None

    def value(self, objective: ObjectiveSettings) -> float:
        """Of an objective; the rig can be, or it would not be judged."""
        assert self.assessment.values is not None
        return self.assessment.values[objective.name]


def best_trials(study: optuna.Study, space: Space) -> list[FrozenTrial]:
    """Feasible trials of different rigs, the best first; the Pareto front of several objectives."""
    feasible = [
        trial
        for trial in finished_trials(study)
        if trial.values is not None and assessment_of(trial).feasible
    ]
    if len(study.directions) > 1:
        front = {trial.number for trial in study.best_trials}
        feasible = [trial for trial in feasible if trial.number in front]
    sign = -1 if study.directions[0] == optuna.study.StudyDirection.MAXIMIZE else 1
    by_key: dict[object, FrozenTrial] = {}
    for trial in sorted(feasible, key=lambda t: (sign * t.values[0], t.number)):
        by_key.setdefault(candidate_of(trial, space).key, trial)
    return list(by_key.values())


def judge(
    trials: Sequence[FrozenTrial], space: Space, question: Question, pool: Pool
) -> list[Judged]:
    """The rigs of the first of `trials`, assessed with all rays; best first again by that."""
    chosen = trials[:MOST_EXACT]
    rigs = [candidate_of(trial, space).rig for trial in chosen]
    found = in_order(pool, rigs, exact(question))
    judged = {
        str(trial.number): Judged(rig, assessment, "found", trial.number)
        for rig, assessment, trial in zip(rigs, found, chosen, strict=True)
    }
    return list(best_first(judged, question.objectives[0]).values())


def best_first(judged: Mapping[str, Judged], objective: ObjectiveSettings) -> dict[str, Judged]:
    """By the first objective, if it is no measured one."""
    if objective.measured:
        return dict(judged)
    sign = -1 if objective.best == "maximize" else 1
    return dict(sorted(judged.items(), key=lambda item: sign * item[1].value(objective)))


def exact(question: Question) -> Question:
    """The same question, answered with all rays."""
    return replace(question, azimuth_stride=1)


def stride_error(trials: Sequence[FrozenTrial], judged: Sequence[Judged]) -> float:
    """Largest relative error of the first objective by fewer azimuth steps, over judged rigs."""
    by_number = {trial.number: assessment_of(trial) for trial in trials}
    errors = [0.0]
    for own in judged:
        if own.trial is None or not own.assessment.values:
            continue
        fast = by_number[own.trial].values or {}
        for name, value in own.assessment.values.items():
            if value:
                errors.append(abs(fast[name] / value - 1))
    return max(errors)

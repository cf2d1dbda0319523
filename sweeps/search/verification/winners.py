"""What a search has found: its rigs, compared exactly with the paper's."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import optuna
import pandas as pd
from optuna.trial import FrozenTrial

from lidarplace import OccupancyGrid
from sweeps.configuration.search import ObjectiveSettings
from sweeps.search.greedy.certificate import Certificate
from sweeps.search.problem.assess import Assessment, Question
from sweeps.search.problem.choice import Choices
from sweeps.search.problem.problem import Problem
from sweeps.search.problem.space import Space
from sweeps.search.trials.study import Timing, assessment_of, finished_trials
from sweeps.search.trials.traffic import Pool

MOST_EXACT = 20
"""Best rigs that are assessed again with all rays."""


@dataclass(frozen=True)
class Judged:
    """A rig (found, greedy or paper) assessed with all rays; objectives as the search computes
    them, with its azimuth stride, or measured of a trial; and on the traffic of the choice, where a
    generalist judges."""

    rig: Choices
    assessment: Assessment
    role: str
    searched: Mapping[str, float]
    chosen: Mapping[str, float] = field(default_factory=dict)

    @property
    def all_values(self) -> dict[str, float]:
        """By name of the objective: of the choice, or with all rays where there are rays."""
        return dict(self.searched) | (self.assessment.values or {}) | dict(self.chosen)

    def value(self, objective: ObjectiveSettings) -> float:
        """Of an objective, NaN if it is not known."""
        return self.all_values.get(objective.name, math.nan)


def best_trials(study: optuna.Study, space: Space) -> list[FrozenTrial]:
    """Feasible trials of different rigs, the best first; or the Pareto front."""
    known = (trial for trial in finished_trials(study) if trial.values is not None)
    feasible = [trial for trial in known if assessment_of(trial).feasible]
    if len(study.directions) > 1:
        front = {trial.number for trial in study.best_trials}
        feasible = [trial for trial in feasible if trial.number in front]
    sign = -1 if study.directions[0] == optuna.study.StudyDirection.MAXIMIZE else 1
    by_rig: dict[Choices, FrozenTrial] = {}
    for trial in sorted(feasible, key=lambda t: (sign * t.values[0], t.number)):
        by_rig.setdefault(space.rig(trial.params), trial)
    return list(by_rig.values())


def judged(
    problem: Problem, trials: Sequence[FrozenTrial], certificate: Certificate | None, pool: Pool
) -> dict[str, Judged]:
    """The best of the search, greedy's rigs and the paper's."""
    others = {}
    if certificate is not None and certificate.chosen:  # nothing, where no LiDAR sees anything
        others["greedy"] = certificate.rig
    if certificate is not None and certificate.refined is not None:
        others["refined"] = certificate.refined
    found = _of_trials(trials, problem, pool)
    rigs = {f"found_{i}": own for i, own in enumerate(found, start=1)}
    for role, own in (("greedy", others), ("paper", problem.paper_rigs())):
        rigs |= _of_others(own, role, problem.question, pool)
    return rigs


def _of_trials(trials: Sequence[FrozenTrial], problem: Problem, pool: Pool) -> list[Judged]:
    """Rigs of the best trials, assessed with all rays. The first MOST_EXACT of them, the best first
    by what is exact; of a Pareto front as many, spread over it, without those that others dominate
    then."""
    question, chosen = problem.question, trials[:MOST_EXACT]
    several = len(question.objectives) > 1
    if several:  # at even distances, both ends among them
        places = np.linspace(0, len(trials) - 1, len(chosen))
        chosen = [trials[round(place)] for place in places.tolist()]
    rigs = [problem.space.rig(trial.params) for trial in chosen]
    names, found = [objective.name for objective in question.objectives], []
    for trial, rig, own in zip(chosen, rigs, pool.in_order(rigs, exact(question)), strict=True):
        found.append(Judged(rig, own, "found", dict(zip(names, trial.values, strict=True))))
    if several:
        found = [own for own in found if not _is_dominated(own, found, question)]
    return sorted(found, key=_rank(question.objectives[0]))


def _is_dominated(own: Judged, others: Sequence[Judged], question: Question) -> bool:
    """Whether another rig is at least as good in all objectives and better in one."""

    def costs(rig: Judged) -> list[float]:
        return [(-1 if o.best == "maximize" else 1) * rig.value(o) for o in question.objectives]

    mine = costs(own)
    return any(
        all(theirs <= value for theirs, value in zip(costs(other), mine, strict=True))
        and costs(other) != mine
        for other in others
    )


def _of_others(
    rigs: Mapping[str, Choices], role: str, question: Question, pool: Pool
) -> dict[str, Judged]:
    """Rigs that no trial found, with all rays and as the search computes them; the best first."""
    both = [pool.in_order(list(rigs.values()), asked) for asked in (exact(question), question)]
    found = {
        name: Judged(rig, all_rays, role, fast.values or {})
        for (name, rig), all_rays, fast in zip(rigs.items(), *both, strict=True)
    }
    return ranked(found, question.objectives[0])


def ranked(judged: Mapping[str, Judged], objective: ObjectiveSettings) -> dict[str, Judged]:
    """The same, the best first."""
    rank = _rank(objective)
    return dict(sorted(judged.items(), key=lambda item: rank(item[1])))


def _rank(objective: ObjectiveSettings) -> Callable[[Judged], tuple[bool, float]]:
    """Key that sorts the best rig first, and those without a value last."""
    sign = -1 if objective.best == "maximize" else 1
    return lambda own: (math.isnan(own.value(objective)), sign * own.value(objective))


def exact(question: Question) -> Question:
    """The same question, answered with all rays."""
    return replace(question, azimuth_stride=1)


def stride_error(judged: Collection[Judged]) -> float:
    """Largest relative error by fewer azimuth steps over rigs and objectives."""
    errors = (
        abs(own.searched[name] / value - 1)
        for own in judged
        for name, value in (own.assessment.values or {}).items()
        if value and name in own.searched
    )
    return max(errors, default=0.0)


@dataclass(frozen=True)
class Found:
    """What a search has found.

    Attributes:
        trials: the best of the study.
        certificate: None if there is none, for the reason `no_certificate`.
        judged: found_1, ..., greedy, and the paper's, each the best first.
        robustness: None if it was not asked for, or nothing was found.
        grids: POG by class; empty if no surrogate was asked for.
        chosen: what the generalist measured on the traffic of the choice; None without one.
    """

    study: optuna.Study
    trials: list[FrozenTrial]
    certificate: Certificate | None
    no_certificate: str | None
    judged: Mapping[str, Judged]
    robustness: pd.DataFrame | None
    grids: Mapping[str, OccupancyGrid]
    timing: Timing
    chosen: pd.DataFrame | None = None

    def of_role(self, role: str) -> dict[str, Choices]:
        """Rigs by name, the best first."""
        return {name: own.rig for name, own in self.judged.items() if own.role == role}

    @property
    def best(self) -> list[str]:
        """Names of the rigs that were found, in order."""
        return list(self.of_role("found"))

    @property
    def baseline(self) -> str:
        return baseline_of(self.judged)


def baseline_of(judged: Mapping[str, Judged]) -> str:
    """The best of the paper's eight among rigs of which the best come first."""
    return next(name for name, own in judged.items() if own.role == "paper")

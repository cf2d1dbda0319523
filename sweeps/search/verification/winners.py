"""The best rigs of a search, assessed exactly as the paper's."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import optuna
import pandas as pd
from numpy.typing import NDArray
from optuna.trial import FrozenTrial

from lidarplace import OccupancyGrid
from sweeps.configuration.objective import ObjectiveSettings
from sweeps.search.greedy.certificate import Certificate, slots_of
from sweeps.search.problem.assess import Assessment, Criteria
from sweeps.search.problem.plain_rigs import plain_rigs
from sweeps.search.problem.problem import SearchProblem
from sweeps.search.problem.rig import Rig
from sweeps.search.problem.space import Space
from sweeps.search.trials.study import Timing, assessment_of, finished_trials
from sweeps.search.trials.traffic import Pool

MOST_EXACT = 20
"""Number of best rigs that are assessed again with all rays."""


@dataclass(frozen=True)
class AssessedRig:
    """A rig (found, greedy or paper) assessed with all rays.

    Attributes:
        searched: objectives as the search computes them, with its azimuth stride, or measured.
        chosen: objectives on the traffic of the choice, where a generalist evaluates."""

    rig: Rig
    assessment: Assessment
    role: str
    searched: Mapping[str, float]
    chosen: Mapping[str, float] = field(default_factory=dict)

    @property
    def all_values(self) -> dict[str, float]:
        """Objectives by name: of the choice, or with all rays where there are rays."""
        return dict(self.searched) | (self.assessment.values or {}) | dict(self.chosen)

    def value(self, objective: ObjectiveSettings) -> float:
        """Return an objective; NaN if it is not known."""
        return self.all_values.get(objective.name, math.nan)


def best_trials(study: optuna.Study, space: Space) -> list[FrozenTrial]:
    """Return feasible trials of different rigs, the best first; or the Pareto front."""
    evaluated = (trial for trial in finished_trials(study) if trial.values is not None)
    feasible = [trial for trial in evaluated if assessment_of(trial).feasible]
    if len(study.directions) > 1:
        front = {trial.number for trial in study.best_trials}
        feasible = [trial for trial in feasible if trial.number in front]
    sign = -1 if study.directions[0] == optuna.study.StudyDirection.MAXIMIZE else 1
    by_rig: dict[Rig, FrozenTrial] = {}
    for trial in sorted(feasible, key=lambda t: (sign * t.values[0], t.number)):
        by_rig.setdefault(space.rig(trial.params), trial)
    return list(by_rig.values())


def assess_best(
    problem: SearchProblem,
    trials: Sequence[FrozenTrial],
    certificate: Certificate | None,
    pool: Pool,
) -> dict[str, AssessedRig]:
    """Assess the best of the search, greedy's, and plain rigs or the paper's; the best first."""
    greedy_rigs = {}
    if certificate is not None and certificate.chosen:  # nothing, where no LiDAR sees anything
        greedy_rigs["greedy"] = certificate.rig
    if certificate is not None and certificate.refined is not None:
        greedy_rigs["refined"] = certificate.refined
    best = _of_trials(trials, problem, pool)
    rigs = {f"found_{number}": rig for number, rig in enumerate(best, start=1)}
    rigs |= _of_others(greedy_rigs, "greedy", problem.criteria, pool)
    plain = _plain_rigs(problem, best) | problem.start_peers
    peers, role = (plain, "plain") if plain else (problem.paper_rigs(), "paper")
    return rigs | _of_others(peers, role, problem.criteria, pool)


def _plain_rigs(problem: SearchProblem, best: Sequence[AssessedRig]) -> dict[str, Rig]:
    """Return plain rigs of an own vehicle; none for the sedan, or if the search has no best rig."""
    placed = slots_of(best[0].rig, problem) if best and problem.file.search.vehicle else None
    return {} if placed is None else plain_rigs(problem.space, placed)


def _of_trials(
    trials: Sequence[FrozenTrial], problem: SearchProblem, pool: Pool
) -> list[AssessedRig]:
    """Assess rigs of the best trials with all rays.

    Returns the first MOST_EXACT of them, the best first by their exact values; of a Pareto front as
    many, spread over it, without those that others dominate then."""
    criteria, chosen = problem.criteria, trials[:MOST_EXACT]
    several = len(criteria.objectives) > 1
    if several:  # at even distances, both ends among them
        places = np.linspace(0, len(trials) - 1, len(chosen))
        chosen = [trials[round(place)] for place in places.tolist()]
    rigs = [problem.space.rig(trial.params) for trial in chosen]
    names, assessments = [o.name for o in criteria.objectives], pool.in_order(rigs, exact(criteria))
    assessed = [
        AssessedRig(rig, assessment, "found", dict(zip(names, trial.values, strict=True)))
        for trial, rig, assessment in zip(chosen, rigs, assessments, strict=True)
    ]
    if several:
        assessed = [rig for rig in assessed if not _is_dominated(rig, assessed, criteria)]
    return sorted(assessed, key=_rank(criteria.objectives[0]))


def _is_dominated(rig: AssessedRig, others: Sequence[AssessedRig], criteria: Criteria) -> bool:
    """Return whether another rig is at least as good in all objectives and better in one."""
    signs = [-1 if objective.best == "maximize" else 1 for objective in criteria.objectives]

    def costs(rig: AssessedRig) -> NDArray[np.float64]:
        return np.array(signs) * [rig.value(objective) for objective in criteria.objectives]

    differences = [costs(other) - costs(rig) for other in others]
    return any((difference <= 0).all() and (difference < 0).any() for difference in differences)


def _of_others(
    rigs: Mapping[str, Rig], role: str, criteria: Criteria, pool: Pool
) -> dict[str, AssessedRig]:
    """Assess rigs of no trial, with all rays and as the search computes them; the best first."""
    precise = pool.in_order(list(rigs.values()), exact(criteria))
    as_searched = pool.in_order(list(rigs.values()), criteria)
    assessed = {
        name: AssessedRig(rig, all_rays, role, fast.values or {})
        for (name, rig), all_rays, fast in zip(rigs.items(), precise, as_searched, strict=True)
    }
    return ranked(assessed, criteria.objectives[0])


def ranked(rigs: Mapping[str, AssessedRig], objective: ObjectiveSettings) -> dict[str, AssessedRig]:
    """Sort rigs by an objective, the best first."""
    rank = _rank(objective)
    return dict(sorted(rigs.items(), key=lambda item: rank(item[1])))


def _rank(objective: ObjectiveSettings) -> Callable[[AssessedRig], tuple[bool, float]]:
    """Return a sort key: the best rig first, those without a value last."""
    sign = -1 if objective.best == "maximize" else 1
    return lambda rig: (math.isnan(rig.value(objective)), sign * rig.value(objective))


def exact(criteria: Criteria) -> Criteria:
    """Return the criteria with all rays."""
    return replace(criteria, azimuth_stride=1)


def stride_error(rigs: Collection[AssessedRig]) -> float:
    """Return the largest relative error by fewer azimuth steps over rigs and objectives."""
    errors = (
        abs(rig.searched[name] / value - 1)
        for rig in rigs
        for name, value in (rig.assessment.values or {}).items()
        if value and name in rig.searched
    )
    return max(errors, default=0.0)


@dataclass(frozen=True)
class SearchFindings:
    """Results of a search.

    Attributes:
        trials: the best of the study.
        certificate: None if there is none, for the reason `no_certificate`.
        rigs: found_1, ..., greedy, and plain ones or the paper's, each the best first.
        robustness: None if it was not configured, or no rig was found.
        grids: POG by class; empty if no surrogate is an objective.
        chosen: measurements of the generalist on the traffic of the choice; None without one."""

    study: optuna.Study
    trials: list[FrozenTrial]
    certificate: Certificate | None
    no_certificate: str | None
    rigs: Mapping[str, AssessedRig]
    robustness: pd.DataFrame | None
    grids: Mapping[str, OccupancyGrid]
    timing: Timing
    chosen: pd.DataFrame | None = None

    def of_role(self, role: str) -> dict[str, Rig]:
        """Return rigs by name, the best first."""
        return {name: assessed.rig for name, assessed in self.rigs.items() if assessed.role == role}

    @property
    def best(self) -> list[str]:
        """Names of the rigs that were found, in order."""
        return list(self.of_role("found"))

    @property
    def baseline(self) -> str:
        """Name of the best of the plain rigs, or of the paper's."""
        return baseline_of(self.rigs)


def baseline_of(rigs: Mapping[str, AssessedRig]) -> str:
    """Return the best of the plain rigs that keeps all constraints, or of the paper's eight.

    Of `rigs` the best come first."""
    peers = {name: rig for name, rig in rigs.items() if rig.role in ("plain", "paper")}
    eligible = (n for n, r in peers.items() if r.role == "paper" or r.assessment.feasible)
    return next(eligible, next(iter(peers)))

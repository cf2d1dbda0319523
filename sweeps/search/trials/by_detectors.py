"""Candidates assessed by detectors: trained, evaluated, and stopped early where hopeless."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import optuna
import pandas as pd

from lidarplace.base.metrics import METRICS, RANKING
from sweeps.configuration.search import ObjectiveSettings
from sweeps.execution.backends import Backend
from sweeps.execution.execute import Listener, Outcome, execute
from sweeps.plan.plan import make_plan
from sweeps.plan.trial import DetectorTrial, Plan, with_detector
from sweeps.results.trial_results import headline_value, metric_mean
from sweeps.search.problem.assess import Assessment
from sweeps.search.problem.problem import Problem
from sweeps.search.trials.pool import Pool
from sweeps.search.trials.study import Candidate, tell
from sweeps.store.of_sweep import reference
from sweeps.store.open import AnyStore


@dataclass
class TrainingAnswers:
    """Answers by fine-tuning and evaluating detectors.

    Rigs that violate a constraint are not trained. What is left climbs the rungs: after each, all
    that were trained report, and then Optuna's pruner decides, so that its verdict does not depend
    on which training was faster. Results stay in the store, so a stop loses nothing.

    Attributes:
        pool: tells constraints and prices.
        listener: is told of the tasks.
    """

    study: optuna.Study
    problem: Problem
    pool: Pool
    store: AnyStore
    backend: Backend
    listener: Listener

    def __post_init__(self) -> None:
        self._asked: list[tuple[optuna.Trial, Candidate]] = []
        self._reference = reference(self.problem.sweep(), "trainings")
        self._referred = set(self.store.references().get(self._reference, ()))

    def begin(self, trial: optuna.Trial, candidate: Candidate) -> None:
        self._asked.append((trial, candidate))

    def finish(self) -> None:
        asked, self._asked = self._asked, []
        found = self.pool.in_order([c.rig for _, c in asked], self.problem.question)
        alive = [
            (trial, candidate)
            for (trial, candidate), assessment in zip(asked, found, strict=True)
            if assessment.feasible
        ]
        failures: dict[int, str] = {}
        objectives = self.problem.file.search.objective
        for step, rung in enumerate(self.problem.file.search.rungs, start=1):
            values, failed = self._train([candidate for _, candidate in alive], rung)
            failures |= failed
            alive = [(trial, c) for trial, c in alive if c.number not in failed]
            for trial, candidate in alive:
                _report(trial, values[candidate.number][0], 2 ** (step - 1))
            alive = [(trial, c) for trial, c in alive if not _is_pruned(trial, step)]
        values, failed = self._train([candidate for _, candidate in alive], {})
        failures |= failed
        for (trial, candidate), assessment in zip(asked, found, strict=True):
            number = candidate.number
            own = all_values(objectives, assessment, values[number]) if number in values else None
            tell(self.study, trial, assessment, own, failures.get(number))

    def _train(
        self, candidates: Sequence[Candidate], rung: Mapping[str, Any]
    ) -> tuple[dict[int, list[float]], dict[int, str]]:
        """Measured values by number of the trial, and reasons of those that failed."""
        if not candidates:
            return {}, {}
        plan = self._plan(candidates, rung)
        trials = with_detector(plan.trials)
        tasks = plan.needed_for(trial.evaluate for trial in trials)
        self._referred |= {task.key for task in tasks}
        self.store.refer(self._reference, self._referred)
        outcome = execute(tasks, self.store, self.backend, self.listener)
        values, failed = {}, {}
        for candidate in candidates:
            own = [t for t in trials if t.grid_point.point.placement == _name(candidate)]
            reason = next((_failure(t, outcome) for t in own if _failure(t, outcome)), None)
            if reason is not None:
                failed[candidate.number] = reason
                continue
            found = [
                measured_value(objective, own, self.store)
                for objective in self.problem.file.search.objective
                if objective.measured
            ]
            if any(math.isnan(value) for value in found):
                failed[candidate.number] = "no object of the class in the test frames"
            else:
                values[candidate.number] = found
        return values, failed

    def _plan(self, candidates: Sequence[Candidate], rung: Mapping[str, Any]) -> Plan:
        rigs = {_name(candidate): candidate.rig for candidate in candidates}
        trials = {_name(c): c.values for c in candidates}
        return make_plan(self.problem.sweep_of(rigs, trials, rung))


def _report(trial: optuna.Trial, value: float, step: int) -> None:
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        trial.report(value, step)  # a trial that was stopped has reported already


def _is_pruned(trial: optuna.Trial, rung: int) -> bool:
    """The pruner's verdict after a rung; kept, as it would be another one after a stop."""
    name = f"pruned after rung {rung}"
    if name not in trial.user_attrs:
        trial.set_user_attr(name, trial.should_prune())
    return bool(trial.user_attrs[name])


def _name(candidate: Candidate) -> str:
    return f"trial_{candidate.number}"


def _failure(trial: DetectorTrial, outcome: Outcome) -> str | None:
    failures = (outcome.failures.get(task.key) for task in (trial.finetune, trial.evaluate))
    return next((failure.reason for failure in failures if failure is not None), None)


def measured_value(
    objective: ObjectiveSettings, trials: Sequence[DetectorTrial], store: AnyStore
) -> float:
    """The weighted mean over classes of a metric's mean over seeds, percent."""
    weights = class_weights(objective, trials[0].grid_point.point.classes)
    return _mean({c: metric_mean(trials, objective.by, c, store) for c in weights}, weights)


def weighted_value(
    objective: ObjectiveSettings, classes: Sequence[str], metrics: pd.DataFrame
) -> float:
    """The weighted mean over classes of a metric, percent; `metrics` as of `evaluate_boxes`."""
    weights = class_weights(objective, classes)
    return _mean({c: headline_value(metrics, objective.by, c) for c in weights}, weights)


def all_values(
    objectives: Sequence[ObjectiveSettings], assessment: Assessment, measured: Sequence[float]
) -> list[float]:
    """Values of all objectives, in their order; `measured` those that detectors measured."""
    assert assessment.values is not None
    left = iter(measured)
    return [next(left) if o.measured else assessment.values[o.name] for o in objectives]


def class_weights(objective: ObjectiveSettings, classes: Iterable[str]) -> dict[str, float]:
    """Weight by class; of all objects together where the metric is of them and none is named."""
    assert objective.by in RANKING
    of_all = METRICS[objective.by].of_all and objective.weights is None
    return {"all": 1.0} if of_all else objective.weights_of(classes)


def _mean(values: Mapping[str, float], weights: Mapping[str, float]) -> float:
    total = math.fsum(weight * values[name] for name, weight in weights.items())
    return total / math.fsum(weights.values())

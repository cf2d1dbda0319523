"""Candidates assessed by detectors: trained and evaluated."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import pandas as pd

from lidarplace.base.metrics import METRICS, RANKING
from sweeps.configuration.search import ObjectiveSettings
from sweeps.execution.execute import Outcome
from sweeps.plan.plan import make_plan
from sweeps.plan.trial import DetectorTrial, with_detector
from sweeps.results.trial_results import headline_value, metric_mean
from sweeps.search.trials.by_tasks import Asked, Measured, TaskAnswers
from sweeps.search.trials.study import Candidate
from sweeps.store.open import AnyStore


class TrainingAnswers(TaskAnswers):
    """Answers by fine-tuning and evaluating detectors."""

    purpose = "trainings"

    def measure(self, asked: Asked) -> Measured:
        """Train and evaluate a detector for each."""
        candidates = [candidate for _, candidate in asked]
        rigs = {_name(candidate): candidate.rig for candidate in candidates}
        plan = make_plan(self.problem.sweep_of(rigs, list(rigs), {}))
        trials = with_detector(plan.trials)
        outcome = self.execute(plan.needed_for(trial.evaluate for trial in trials))
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


def _name(candidate: Candidate) -> str:
    return f"trial_{candidate.number}"


def _failure(trial: DetectorTrial, outcome: Outcome) -> str | None:
    failures = (outcome.failures.get(task.key) for task in (trial.learns, trial.evaluate))
    return next((failure.reason for failure in failures if failure is not None), None)


def measured_value(
    objective: ObjectiveSettings, trials: Sequence[DetectorTrial], store: AnyStore
) -> float:
    """The weighted mean over classes of a metric's mean over seeds, percent; of `also`, too."""
    classes = trials[0].grid_point.point.classes
    return _mean_of_parts(objective, classes, lambda by, c: metric_mean(trials, by, c, store))


def weighted_value(
    objective: ObjectiveSettings, classes: Sequence[str], metrics: pd.DataFrame
) -> float:
    """The same of one table; `metrics` as of `evaluate_boxes`."""
    return _mean_of_parts(objective, classes, lambda by, c: headline_value(metrics, by, c))


def _mean_of_parts(
    objective: ObjectiveSettings, classes: Iterable[str], value: Callable[[str, str], float]
) -> float:
    found = []
    for part in objective.parts:
        weights = class_weights(part, classes)
        found.append(_mean({c: value(part.by, c) for c in weights}, weights))
    return math.fsum(found) / len(found)


def class_weights(objective: ObjectiveSettings, classes: Iterable[str]) -> dict[str, float]:
    """Weight by class; of all objects together where the metric is of them and none is named."""
    assert objective.by in RANKING
    of_all = METRICS[objective.by].of_all and objective.weights is None
    return {"all": 1.0} if of_all else objective.weights_of(classes)


def _mean(values: Mapping[str, float], weights: Mapping[str, float]) -> float:
    total = math.fsum(weight * values[name] for name, weight in weights.items())
    return total / math.fsum(weights.values())

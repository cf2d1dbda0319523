"""Logs a trial to MLflow as soon as its last task has ended."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import pandas as pd

from sweeps.failures import Failure, FailureFolder
from sweeps.plan import Plan, Trial
from sweeps.progress import StageProgress
from sweeps.promotion import Promotion
from sweeps.store import AnyStore
from sweeps.task import Task
from sweeps.trial_results import trial_failure, trial_results, trial_seconds, trial_surrogates
from tracking.mlflow_log import SweepLog, trial_metrics

STATUS_TAG = "lidarplace.status"
REASON_TAG = "lidarplace.reason"


class TrialLog:
    """The executor's listener: shows progress, and hands what has ended to MLflow.

    The driver is the only writer.
    """

    def __init__(
        self,
        progress: StageProgress,
        log: SweepLog,
        plan: Plan,
        store: AnyStore,
        axes: Sequence[str],
        failures: FailureFolder,
    ) -> None:
        self._progress = progress
        self._log = log
        self._store = store
        self._axes = axes
        self._failures = failures
        self._open = {trial.key: trial for trial in plan.trials}
        there = store.finished(task for trial in plan.trials for task in trial.results)
        self._missing: dict[str, set[str]] = {}
        self._waiting: dict[str, list[Trial]] = defaultdict(list)
        for trial in plan.trials:
            keys = {task.key for task in trial.results} - there
            self._missing[trial.key] = keys
            for key in keys:
                self._waiting[key].append(trial)
        for trial in plan.trials:
            if not self._missing[trial.key]:
                self._log_finished(trial)

    def log_rest(self, promotion: Promotion, failures: Mapping[str, Failure]) -> None:
        """Log the trials that have no result, with the reason."""
        for trial in self._open.values():
            known = self._store.has(trial.surrogates)
            metrics = self._metrics(trial, pd.DataFrame()) if known else {}
            pruned = promotion.pruned.get(trial.key)
            failure = trial_failure(trial, failures)
            params = self._params(trial)
            if pruned is not None:
                tags = {STATUS_TAG: "pruned", REASON_TAG: pruned}
                self._log.trial(trial.key, trial.label, params, metrics, tags=tags)
            elif failure is not None:
                self._log.trial(trial.key, trial.label, params, metrics, error=failure.reason)

    def started(self, task: Task) -> None:
        self._progress.started(task)

    def finished(self, task: Task) -> None:
        self._progress.finished(task)
        for trial in self._waiting.pop(task.key, ()):
            missing = self._missing[trial.key]
            missing.discard(task.key)
            if not missing:
                self._log_finished(trial)

    def failed(self, task: Task, failure: Failure) -> None:
        self._progress.failed(task, failure)
        self._failures.write(task, failure)

    def _log_finished(self, trial: Trial) -> None:
        del self._open[trial.key]
        metrics = self._metrics(trial, trial_results(trial, self._store, self._axes))
        metrics["seconds"] = trial_seconds(trial, self._store)
        params, curve = self._params(trial), None
        if trial.finetune is not None:
            names = ("weights", "batch_size", "classes", "curve")
            training = self._store.load(trial.finetune, names)
            params |= {
                "weights": training["weights"],
                "batch_size": training["batch_size"],
                "trained_classes": ", ".join(training["classes"]),
            }
            curve = training["curve"]
        tags = {STATUS_TAG: "finished"}
        self._log.trial(trial.key, trial.label, params, metrics, curve, tags=tags)

    def _metrics(self, trial: Trial, results: pd.DataFrame) -> dict[str, float]:
        surrogates = trial_surrogates(trial, self._store, self._axes)
        placement = trial.grid_point.point.placement
        return trial_metrics(results, surrogates, placement, self._setting(trial))

    def _setting(self, trial: Trial) -> dict[str, object]:
        return {axis: trial.grid_point.axes[axis] for axis in self._axes}

    def _params(self, trial: Trial) -> dict[str, object]:
        point = trial.grid_point.point
        params = {"placement": point.placement, **self._setting(trial)}
        if point.detector is None:  # may be thousands: MLflow takes its time for every parameter
            return params
        training = point.training.model_dump(mode="json")
        scene = point.scene.model_dump(mode="json")
        return (
            params
            | {"detector": point.detector, "seed": point.seed}
            | {f"training.{key}": value for key, value in training.items()}
            | {f"scene.{key}": value for key, value in scene.items()}
        )

"""Logs a trial to MLflow as soon as its last task has ended."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.progress import StageProgress
from sweeps.mlflow.page import datasets, tags
from sweeps.mlflow.trial_pictures import trial_pictures
from sweeps.plan.plan import Plan, Trial
from sweeps.results.trial_results import trial_failure, trial_results, trial_seconds
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task
from tracking.mlflow.log import SweepLog, trial_metrics


class TrialLog:
    """The executor's listener: shows progress, and hands what has ended to MLflow.

    The driver is the only writer. Trials without a detector, and those that were pruned before they
    began, have no run: they may be thousands, and MLflow takes some 40 ms of a core for each. Their
    values are in the tables that the parent run keeps.
    """

    def __init__(
        self,
        progress: StageProgress,
        log: SweepLog,
        plan: Plan,
        store: AnyStore,
        axes: Sequence[str],
        failures: FailureFolder,
        pictures: Path,
    ) -> None:
        self._progress = progress
        self._log = log
        self._store = store
        self._axes = axes
        self._failures = failures
        self._pictures = pictures
        trials = [trial for trial in plan.trials if trial.evaluate is not None]
        self._open = {trial.key: trial for trial in trials}
        there = store.finished(task for trial in trials for task in trial.results)
        self._missing: dict[str, set[str]] = {}
        self._waiting: dict[str, list[Trial]] = defaultdict(list)
        for trial in trials:
            keys = {task.key for task in trial.results} - there
            self._missing[trial.key] = keys
            for key in keys:
                self._waiting[key].append(trial)
        for trial in trials:
            if not self._missing[trial.key]:
                self._log_finished(trial)

    def log_rest(self, failures: Mapping[str, Failure]) -> None:
        """Log the trials that failed, with the reason, and those that another driver finished."""
        for trial in list(self._open.values()):
            if all(self._store.has(task) for task in trial.results):
                self._log_finished(trial)
                continue
            failure = trial_failure(trial, failures)
            if failure is not None:
                known = self._store.has(trial.surrogates)
                metrics = self._metrics(trial, pd.DataFrame()) if known else {}
                params = self._params(trial)
                self._log.trial(
                    trial.key,
                    trial.label,
                    params,
                    metrics,
                    error=failure.reason,
                    tags=tags(trial, self._axes),
                )

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
        if self._log.is_settled(trial.key):
            return
        metrics = self._metrics(trial, trial_results(trial, self._store, self._axes))
        metrics["seconds"] = trial_seconds(trial, self._store)
        assert trial.finetune is not None
        assert trial.evaluate is not None
        records = [self._store.record(task) for task in (trial.finetune, trial.evaluate)]
        metrics["peak_memory_megabytes"] = max(r["peak_memory"] for r in records) / 1e6
        training = self._store.load(trial.finetune, ("weights", "batch_size", "classes", "curve"))
        params = self._params(trial) | {
            "weights": training["weights"],
            "batch_size": training["batch_size"],
            "trained_classes": ", ".join(training["classes"]),
        }
        metrics["batch_size"] = training["batch_size"]
        self._log.trial(
            trial.key,
            trial.label,
            params,
            metrics,
            training["curve"],
            tags=tags(trial, self._axes),
            datasets=datasets(trial),
            files=trial_pictures(trial, self._store, self._pictures),
        )

    def _metrics(self, trial: Trial, results: pd.DataFrame) -> dict[str, float]:
        surrogates = self._store.load(trial.surrogates, ("table",))["table"]
        return trial_metrics(results, surrogates)

    def _params(self, trial: Trial) -> dict[str, object]:
        point = trial.grid_point.point
        return {
            "placement": point.placement,
            "detector": point.detector,
            "seed": point.seed,
            **{axis: trial.grid_point.axes[axis] for axis in self._axes},
            **{f"training.{k}": v for k, v in point.training.model_dump(mode="json").items()},
            **{f"scene.{k}": v for k, v in point.scene.model_dump(mode="json").items()},
        }

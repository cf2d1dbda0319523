"""Logs a trial to MLflow as soon as its last task has ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sweeps.plan import Plan, Trial
from sweeps.progress import StageProgress
from sweeps.store import Store, write_text
from sweeps.task import Task
from sweeps.write_run import (
    trial_failure,
    trial_results,
    trial_seconds,
    trial_surrogates,
)
from tracking.mlflow_log import SweepLog, trial_metrics


class TrialLog:
    """The executor's listener: shows progress, and writes what has ended to MLflow.

    The driver is the only writer. A trial that MLflow has already is not logged again.
    """

    def __init__(
        self,
        progress: StageProgress,
        log: SweepLog,
        plan: Plan,
        store: Store,
        axes: Sequence[str],
        failed_folder: Path,
    ) -> None:
        self._progress = progress
        self._log = log
        self._store = store
        self._axes = axes
        self._failed_folder = failed_folder
        self._open = list(plan.trials)

    def log_finished(self) -> None:
        """Log all trials whose results are in the store and that have not been looked at."""
        finished = [t for t in self._open if all(self._store.has(task) for task in t.results)]
        for trial in finished:
            self._open.remove(trial)
            self._log_trial(trial)

    def log_failed(self, failures: Mapping[str, str]) -> None:
        """Log the trials that have no result, with the reason."""
        for trial in self._open:
            self._log.trial(
                trial.key,
                trial.label,
                self._params(trial),
                {},
                error=trial_failure(trial, failures),
            )

    def started(self, task: Task) -> None:
        self._progress.started(task)

    def finished(self, task: Task) -> None:
        self._progress.finished(task)
        if any(task in trial.results for trial in self._open):
            self.log_finished()

    def failed(self, task: Task, reason: str, log: str) -> None:
        self._progress.failed(task, reason, log)
        write_failure(self._failed_folder, task, log)

    def _log_trial(self, trial: Trial) -> None:
        results = trial_results(trial, self._store, self._axes)
        surrogates = trial_surrogates(trial, self._store, self._axes)
        point = trial.grid_point.point
        setting = {axis: trial.grid_point.axes[axis] for axis in self._axes}
        metrics = trial_metrics(results, surrogates, point.placement, setting)
        metrics["seconds"] = trial_seconds(trial, self._store)
        training = self._store.load(trial.finetune)
        params = self._params(trial) | {
            "weights": training["weights"],
            "batch_size": training["batch_size"],
            "trained_classes": ", ".join(training["classes"]),
        }
        self._log.trial(trial.key, trial.label, params, metrics, training["curve"])

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


def write_failure(folder: Path, task: Task, log: str) -> None:
    """Keep the traceback of a task that failed."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / f"{task.stage}-{task.key}.log", f"{task.label}\n{log}")

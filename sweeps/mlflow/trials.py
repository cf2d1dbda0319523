"""Trials of a sweep that have ended, and the content of their runs at MLflow."""

import time
from collections.abc import Collection, Iterator, Mapping
from functools import partial
from pathlib import Path

import pandas as pd
from rich.console import Console

from sweeps.configuration.grid import Sweep
from sweeps.execution.failures import Failure, FailureFolder
from sweeps.execution.progress import StageProgress
from sweeps.mlflow.experiment import datasets, tags
from sweeps.plan.labels import further_axes
from sweeps.plan.trial import DetectorTrial, Plan, Trial, with_detector
from sweeps.results.promotion import at_most
from sweeps.results.trial_results import (
    surrogate_table,
    trial_failure,
    trial_results,
    trial_seconds,
)
from sweeps.stages.task import Task
from sweeps.store.local import Store
from tracking.mlflow.content import EndedTrial, TrialRun, requirement_metrics, trial_metrics


class TrialLog(StageProgress):
    """Progress of stages that also yields the trials that have ended.

    Trials without a detector, and those that were pruned before they began, have no run: they
    may be thousands, and MLflow takes some 40 ms of a core for each. `cached` are keys of
    results of an earlier run."""

    def __init__(
        self,
        console: Console,
        sweep: Sweep,
        plan: Plan,
        store: Store,
        failures: FailureFolder,
        cached: Collection[str],
        pictures: Path,
    ) -> None:
        super().__init__(console, at_most(sweep, plan), store, failures)
        self._trials = with_detector(plan.trials)
        self._store = store
        self._axes = further_axes(sweep)
        self._times = dict.fromkeys(cached, _now_ms())
        self._known: Mapping[str, Failure] = {}
        self._pictures = pictures

    def ended(self) -> Iterator[EndedTrial]:
        """Yield the trials that have all results, and after `end` those that failed."""
        for trial in self._trials:
            if all(task.key in self._times for task in trial.results):
                yield EndedTrial(trial.key, partial(self._finished, trial))
            elif failure := trial_failure(trial, self._known):
                yield EndedTrial(trial.key, partial(self._without_results, trial), failure.reason)

    def end(self, failures: Mapping[str, Failure]) -> None:
        """Take up the failures, by the task's key, and what another driver finished."""
        finished = self._store.finished(task for trial in self._trials for task in trial.results)
        self._times |= dict.fromkeys(finished - self._times.keys(), _now_ms())
        self._known = failures

    def finished(self, task: Task) -> None:
        """Take up the end of a task."""
        super().finished(task)
        self._times[task.key] = _now_ms()

    def _finished(self, trial: DetectorTrial) -> TrialRun:
        store = self._store
        memory = max(store.record(t).peak_memory for t in (trial.learns, trial.evaluate))
        measured = {"seconds": trial_seconds(trial, store), "peak_memory_megabytes": memory / 1e6}
        about: dict[str, object] = {}
        curve = None
        if trial.finetune is not None:
            weights, batch_size, classes, curve = store.read(
                trial.finetune, lambda own: (own.weights, own.batch_size, own.classes, own.curve)
            )
            about = {"weights": weights, "trained_classes": ", ".join(classes)}
            about["batch_size"] = measured["batch_size"] = batch_size
        return TrialRun(
            trial.label,
            self._params(trial) | about,
            self._metrics(trial, trial_results(trial, store, self._axes)) | measured,
            ended=max(self._times[task.key] for task in trial.results),
            curve=curve,
            tags=tags(trial, self._axes),
            datasets=datasets(trial),
            files=_pictures(trial, store, self._pictures),
        )

    def _without_results(self, trial: Trial) -> TrialRun:
        has_surrogates = trial.surrogates.key in self._times
        metrics = self._metrics(trial, pd.DataFrame()) if has_surrogates else {}
        trial_tags = tags(trial, self._axes)
        return TrialRun(trial.label, self._params(trial), metrics, ended=_now_ms(), tags=trial_tags)

    def _metrics(self, trial: Trial, results: pd.DataFrame) -> dict[str, float]:
        named = trial_metrics(results, surrogate_table(trial, self._store))
        required = trial.requirements
        if required is None or not self._store.has(required):
            return named
        return named | requirement_metrics(self._store.read(required, lambda own: own.table))

    def _params(self, trial: Trial) -> dict[str, object]:
        point = trial.grid_point.point
        return {
            "placement": point.placement,
            "detector": point.detector_name,
            "seed": point.seed,
            **{axis: trial.grid_point.axes[axis] for axis in self._axes},
            **{f"training.{k}": v for k, v in point.training.model_dump(mode="json").items()},
            **{f"scene.{k}": v for k, v in point.scene.model_dump(mode="json").items()},
        }


def _pictures(trial: DetectorTrial, store: Store, folder: Path) -> list[Path]:
    """Draw PNGs of the placement, which trials share, and of precision over recall, each once."""
    from tracking.mlflow.pictures import draw_pr_curves, draw_rig

    # Clouds differ where the rig or its vehicle does.
    placement = folder / trial.collect_test[0].key / "placement.png"
    curves = folder / trial.key / "precision_recall.png"
    if not placement.exists():
        rig = trial.surrogates.stage.placement
        name = trial.grid_point.point.placement
        draw_rig(placement, name, rig.mounts, rig.lidars, trial.grid_point.vehicle)
    table = store.read(trial.evaluate, lambda found: found.pr_curves)
    if table.empty:  # no object of any class in the test frames
        return [placement]
    if not curves.exists():
        draw_pr_curves(curves, trial.label, table)
    return [placement, curves]


def _now_ms() -> int:
    return time.time_ns() // 1_000_000

"""Results of one trial, as tables with its place in the grid in front."""

import math
from collections.abc import Mapping, Sequence

import pandas as pd

from sweeps.execution.failures import Failure
from sweeps.plan.trial import DetectorTrial, Trial
from sweeps.stages.task import Task
from sweeps.store.local import Store
from tracking.findings.groups import ONE_FOR_ALL
from tracking.kitti_iou import at_headline_iou
from tracking.run_folders.table_schema import Cell, cell


def trial_failure(trial: Trial, failures: Mapping[str, Failure]) -> Failure | None:
    """Return why a trial has no result, None if none of its tasks failed."""
    return next((failures[t.key] for t in trial.results if t.key in failures), None)


def trial_results(trial: DetectorTrial, store: Store, axes: Sequence[str]) -> pd.DataFrame:
    """Read the metrics of a trial's evaluation, its identity in front."""
    metrics = store.read(trial.evaluate, lambda found: found.metrics)
    return with_columns(metrics, identity(trial, axes))


def headline_value(metrics: pd.DataFrame, metric: str, object_class: str) -> float:
    """Return a metric of a class at KITTI's IoU, percent; NaN if it was not measured."""
    return next(
        iter(at_headline_iou(metrics, metrics, object_class, metric)["value"].tolist()), math.nan
    )


def trial_seconds(trial: Trial, store: Store) -> float:
    """Sum the seconds of training and evaluation; of the surrogates without a detector.

    A generalist's training counts for none of the placements that it evaluates."""
    tasks: tuple[Task, ...] = trial.scores
    if isinstance(trial, DetectorTrial):
        alone = trial.grid_point.point.evaluator not in ONE_FOR_ALL
        tasks = (trial.learns, trial.evaluate) if alone else (trial.evaluate,)
    return sum(store.record(task).seconds for task in tasks)


def surrogate_table(trial: Trial, store: Store) -> pd.DataFrame:
    """Read a trial's surrogates that have a result: class, surrogate, value, method, seconds."""
    finished = [task for task in trial.scores if store.has(task)]
    return pd.concat(
        [store.read(task, lambda own: own.table) for task in finished], ignore_index=True
    )


def identity(trial: Trial, axes: Sequence[str]) -> dict[str, Cell]:
    """Return the columns that distinguish a trial from others."""
    point = trial.grid_point.point
    columns: dict[str, Cell] = {"trial": trial.key, "placement": point.placement}
    columns |= {"detector": point.detector_name or "", "seed": point.seed}
    return columns | axis_values(trial, axes)


def axis_values(trial: Trial, axes: Sequence[str]) -> dict[str, Cell]:
    """Return a trial's place on these axes, as cells of a table."""
    return {axis: cell(trial.grid_point.axes[axis]) for axis in axes}


def with_columns(table: pd.DataFrame, columns: Mapping[str, Cell]) -> pd.DataFrame:
    """Add constant columns in front of `table`."""
    constant = pd.DataFrame({name: [value] * len(table) for name, value in columns.items()})
    return pd.concat([constant, table], axis=1)

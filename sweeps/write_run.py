"""The run folder: what a sweep found, as tables that stay readable without this project."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from lidarplace.boxes import GEOMETRY
from lidarplace.files import replacing
from lidarplace.lidar.clouds import PointClouds
from sweeps.grid import GridPoint, Sweep
from sweeps.plan import Plan, Trial, further_axes
from sweeps.store import Store, Value, write_text
from sweeps.task import Task

_VERSIONS = ("numpy", "numba", "torch", "ray", "mlflow", "pandas")
_SURROGATE_AXES = ("scene", "roi", "lidar", "surrogate")


def write_run(
    folder: Path,
    sweep: Sweep,
    plan: Plan,
    store: Store,
    failures: Mapping[str, str],
    cached: set[str],
    command: str,
    seconds: float,
) -> None:
    """Gather the results of all trials that ended well into `folder`, each file renamed into place.

    Args:
        failures: reasons by key of the tasks that have no result.
        cached: keys of the tasks that had a result before.
        command: what the user typed.
        seconds: wall time of the sweep.
    """
    folder.mkdir(parents=True, exist_ok=True)
    good = [trial for trial in plan.trials if not trial_failure(trial, failures)]
    axes = further_axes(sweep)
    write_text(folder / "config.yaml", yaml.safe_dump(dict(sweep.source), sort_keys=False))
    for name, table in (
        ("trials", trials_table(plan, store, failures, axes)),
        ("results", _stack([trial_results(t, store, axes) for t in good])),
        ("surrogates", _stack([trial_surrogates(t, store, axes) for t in good])),
        (
            "expected_ig_by_q",
            _stack([_of_placement(t, t.surrogates, "by_q", store, axes) for t in good]),
        ),
        ("curves", _stack([_curve(t, store) for t in good])),
        ("accuracy", _stack([_of_placement(t, t.accuracy, "table", store, axes) for t in good])),
        (
            "sampling_error",
            _stack([_of_placement(t, t.sampling_error, "estimates", store, axes) for t in good]),
        ),
        (
            "pog_resamples",
            _stack([_of_placement(t, t.sampling_error, "resamples", store, axes) for t in good]),
        ),
        ("tasks", _tasks_table(plan.tasks, store, cached)),
    ):
        # Points of the grid share tasks: what they report together stands there once.
        with replacing(folder / f"{name}.parquet") as partial:
            table.drop_duplicates(ignore_index=True).to_parquet(partial, index=False)
    frames = {"train": 0, "test": 0}
    if good:
        for scene in good[0].scenes:
            for split, count in store.load(scene)["frames"]["split"].value_counts().items():
                frames[str(split)] += int(count)
        _save_arrays(folder / "maps.npz", _maps(good, store))
        _save_arrays(folder / "frame.npz", _one_frame(good, store))
    write_text(folder / "sweep.json", json.dumps(_about(sweep, frames, command, seconds), indent=1))


def trial_failure(trial: Trial, failures: Mapping[str, str]) -> str | None:
    """Why a trial has no result, None if it has one."""
    return next((failures[t.key] for t in trial.results if t.key in failures), None)


def trials_table(
    plan: Plan, store: Store, failures: Mapping[str, str], axes: Sequence[str]
) -> pd.DataFrame:
    """One row a trial: trial, placement, detector, seed, axes, seconds, status, error."""
    rows = []
    for trial in plan.trials:
        error = trial_failure(trial, failures)
        seconds = np.nan if error else trial_seconds(trial, store)
        status = "failed" if error else "finished"
        rows.append(
            _identity(trial, axes) | {"seconds": seconds, "status": status, "error": error or ""}
        )
    return pd.DataFrame(rows)


def trial_results(trial: Trial, store: Store, axes: Sequence[str]) -> pd.DataFrame:
    """Metrics of a trial: its identity, class, metric, iou, difficulty, value, ground_truths."""
    metrics = store.load(trial.evaluate)["metrics"]
    return _with(metrics, _identity(trial, axes))


def trial_surrogates(trial: Trial, store: Store, axes: Sequence[str]) -> pd.DataFrame:
    """Surrogates of a trial's placement: placement, axes that matter, class, surrogate, value."""
    return _of_placement(trial, trial.surrogates, "table", store, axes)


def trial_seconds(trial: Trial, store: Store) -> float:
    """Seconds of training and evaluation."""
    return store.seconds(trial.finetune) + store.seconds(trial.evaluate)


def _curve(trial: Trial, store: Store) -> pd.DataFrame:
    return _with(store.load(trial.finetune)["curve"], {"trial": trial.key})


def _of_placement(
    trial: Trial, task: Task, name: str, store: Store, axes: Sequence[str]
) -> pd.DataFrame:
    """A table that depends on the placement and on the axes that matter to surrogates."""
    own = [axis for axis in axes if axis.partition(".")[0] in _SURROGATE_AXES]
    identity = _axis_values(trial.grid_point, own)
    return _with(store.load(task)[name], {"placement": trial.grid_point.point.placement} | identity)


def _tasks_table(tasks: Sequence[Task], store: Store, cached: set[str]) -> pd.DataFrame:
    rows = [
        (task.stage, task.label, task.key, store.seconds(task), task.key in cached)
        for task in tasks
        if store.has(task)
    ]
    return pd.DataFrame(rows, columns=["stage", "label", "key", "seconds", "cached"])


def _identity(trial: Trial, axes: Sequence[str]) -> dict[str, Any]:
    point = trial.grid_point.point
    identity = {
        "trial": trial.key,
        "placement": point.placement,
        "detector": point.detector,
        "seed": point.seed,
    }
    return identity | _axis_values(trial.grid_point, axes)


def _axis_values(grid_point: GridPoint, axes: Sequence[str]) -> dict[str, Any]:
    values = {axis: grid_point.axes[axis] for axis in axes}
    # A list or mapping is no cell of a table.
    return {k: v if isinstance(v, (int, float, str)) else json.dumps(v) for k, v in values.items()}


def _with(table: pd.DataFrame, columns: Mapping[str, Any]) -> pd.DataFrame:
    """`table` with constant columns in front."""
    return pd.concat(
        [pd.DataFrame({k: [v] * len(table) for k, v in columns.items()}), table], axis=1
    )


def _stack(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def _maps(trials: Sequence[Trial], store: Store) -> Value:
    maps = {}
    for trial in trials:
        name = f"coverage/{trial.grid_point.point.placement}"
        if name not in maps:
            maps[name] = store.load(trial.surrogates)["from_above"]
    pog = store.load(trials[0].pog)
    for object_class in pog["classes"]:
        maps[f"pog/{object_class}"] = pog[f"from_above_{object_class}"]
    return maps


def _one_frame(trials: Sequence[Trial], store: Store) -> Value:
    """The test frame with most objects, as every placement sees it."""
    objects = pd.concat([store.load(task)["objects"] for task in trials[0].ground_truths])
    of_test = np.concatenate([store.load(task)["frames"] for task in trials[0].collect_test])
    numbers = objects["frame"].to_numpy()
    found = np.array([np.count_nonzero(numbers == frame) for frame in of_test])
    frame = of_test[np.argmax(found)]
    shown = objects[objects["frame"] == frame]
    arrays: Value = {
        "boxes": shown[list(GEOMETRY)].to_numpy(np.float64),
        "labels": shown["class"].to_numpy(np.str_),
    }
    for trial in trials:
        name = trial.grid_point.point.placement
        for task in trial.collect_test if f"points/{name}" not in arrays else ():
            clouds = PointClouds.from_arrays(store.load(task))
            for index in np.flatnonzero(clouds.frames == frame).tolist():
                arrays[f"points/{name}"] = clouds[index]
                arrays[f"lidar/{name}"] = clouds.lidar(index)
    return arrays


def _about(sweep: Sweep, frames: Mapping[str, int], command: str, seconds: float) -> dict[str, Any]:
    first = sweep.points[0].point
    placements = {}
    for grid_point in sweep.points:
        point = grid_point.point
        rig = sweep.common.placement_named(point.placement, point.lidar.lidar())
        placements[point.placement] = [list(astuple(mount)) for mount in rig.mounts]
    roi = first.roi.model_dump(mode="json") | {"resolution": first.surrogate.resolution}
    return {
        "name": sweep.common.name,
        "command": command,
        "axes": list(further_axes(sweep)),
        "placements": placements,
        "classes": list(first.classes),
        "roi": roi,
        "frames": dict(frames),
        "tracking_uri": sweep.common.tracking_uri,
        "seconds": seconds,
        "versions": {"python": platform.python_version()} | {n: version(n) for n in _VERSIONS},
    }


def _save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]

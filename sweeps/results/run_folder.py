"""The run folder: what a sweep found, as tables that stay readable without this project."""

from __future__ import annotations

import platform
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.clouds.points_in_boxes import points_by_distance
from lidarplace.files.atomic import write_text
from lidarplace.files.secret_urls import hide_secrets, public_url
from lidarplace.mounting.vehicle import Vehicle
from sweeps.configuration.file import public_yaml
from sweeps.configuration.grid import Sweep
from sweeps.execution.execute import Outcome
from sweeps.plan.plan import further_axes
from sweeps.plan.trial import DetectorTrial, Plan, Trial, with_detector
from sweeps.results.failure_frames import failure_frames
from sweeps.results.object_tables import object_tables
from sweeps.results.pictures import drawn, grounds, maps, one_frame
from sweeps.results.promotion import Promotion
from sweeps.results.rig_cautions import rig_cautions
from sweeps.results.rigs import FILE, lidar_models, rigs_yaml
from sweeps.results.trial_results import (
    Cell,
    axis_values,
    identity,
    trial_failure,
    trial_results,
    trial_seconds,
    with_columns,
)
from sweeps.store.open import AnyStore
from sweeps.store.result_folder import R
from sweeps.tasks.results import Evaluated
from sweeps.tasks.task import Task
from tracking.mlflow.uri import absolute_uri
from tracking.report.recommendation import failures_to_show
from tracking.run_folders import sweep_tables as contract
from tracking.run_folders.arrays import FailureFrames, Grounds
from tracking.run_folders.json_file import Triangles
from tracking.run_folders.sweep_json import Anchor, Frames, Rung, SweepResult
from tracking.run_folders.table import Table
from training.typical_objects import as_plain

_VERSIONS = ("numpy", "numba", "torch", "ray", "mlflow", "pandas")


@dataclass(frozen=True)
class Run:
    """What happened when a plan was run.

    Attributes:
        outcome: of its tasks.
        promotion: which trials were pruned.
        cached: keys of the tasks that had a result before.
        cores: tasks that could run at once; None where none ran.
        command: what the user typed.
        started: when, on the clock of `Outcome.times`.
        seconds: that it took.
    """

    outcome: Outcome
    promotion: Promotion
    cached: Collection[str]
    cores: int | None
    command: str
    started: float
    seconds: float


def write_run(folder: Path, sweep: Sweep, plan: Plan, store: AnyStore, run: Run) -> None:
    """Gather the results of all trials into `folder`, each file renamed into place."""
    folder.mkdir(parents=True, exist_ok=True)
    axes = further_axes(sweep)
    there = store.finished(plan.tasks)
    known = [trial for trial in plan.trials if trial.surrogates.key in there]
    good = [trial for trial in known if all(task.key in there for task in trial.results)]
    tested = with_detector(good)

    def gathered(
        own: Table,
        task_of: Callable[[Trial], Task[R] | None],
        table: Callable[[R], pd.DataFrame | None],
    ) -> pd.DataFrame:
        """One table of a stage."""
        return _once(
            own,
            axes,
            (
                (trial, (task,), partial(store.read, task, table))
                for trial in known
                if (task := task_of(trial)) is not None and task.key in there
            ),
        )

    def of_trials(table: Callable[[Evaluated], pd.DataFrame]) -> pd.DataFrame:
        """One table of the evaluations."""
        return _stack([trial_results(trial, store, axes, table) for trial in tested])

    objects, found = object_tables(tested, store, axes)
    surrogates = _stack(
        [
            gathered(contract.SURROGATES, lambda trial: trial.surrogates, lambda own: own.table),
            gathered(contract.SURROGATES, lambda trial: trial.recall, lambda own: own.table),
        ]
    )
    by_q = gathered(contract.EXPECTED_IG_BY_Q, lambda trial: trial.surrogates, lambda own: own.by_q)
    accuracy = gathered(contract.ACCURACY, lambda trial: trial.accuracy, lambda own: own.table)
    estimates = gathered(
        contract.SAMPLING_ERROR, lambda trial: trial.sampling_error, lambda own: own.estimates
    )
    resamples = gathered(
        contract.POG_RESAMPLES, lambda trial: trial.sampling_error, lambda own: own.resamples
    )
    required = gathered(
        contract.REQUIREMENTS, lambda trial: trial.requirements, lambda own: own.table
    )
    points = ((own, own.collect_test, partial(_points, own, store)) for own in tested)
    individuals = ((own, own.ground_truths, partial(_individuals, own, store)) for own in tested)
    write_text(folder / "config.yaml", public_yaml(sweep.source))
    write_text(folder / FILE, rigs_yaml(sweep))
    for table, frame in (
        (contract.TRIALS, trials_table(plan, store, run, axes)),
        (contract.RESULTS, of_trials(lambda own: own.metrics)),
        (contract.SURROGATES, surrogates),
        (contract.EXPECTED_IG_BY_Q, by_q),
        (contract.CURVES, _stack([_curve(t, store) for t in tested if t.finetune is not None])),
        (contract.PR_CURVES, of_trials(lambda own: own.pr_curves)),
        (contract.LEFT_OUT, of_trials(lambda own: own.left_out)),
        (contract.DISTANCE, of_trials(lambda own: own.by_distance)),
        (contract.SECTOR, of_trials(lambda own: own.by_sector)),
        (contract.POINTS, _once(contract.POINTS, axes, points)),
        (contract.INDIVIDUALS, _once(contract.INDIVIDUALS, axes, individuals)),
        (contract.OBJECTS, objects),
        (contract.FOUND, found),
        (contract.ACCURACY, accuracy),
        (contract.SAMPLING_ERROR, estimates),
        (contract.POG_RESAMPLES, resamples),
        (contract.REQUIREMENTS, required),
        (contract.PROMOTIONS, run.promotion.table()),
        (contract.TASKS, _tasks_table(plan.tasks, store, run)),
    ):
        table.write(frame, folder)
    (folder / Grounds.FILE).unlink(missing_ok=True)  # of an earlier run
    frames = {"train": 0, "test": 0}
    pictured: Mapping[str, Cell] = {}
    body = plan.trials[0].grid_point.vehicle
    if known:
        for scene in (task for task in known[0].scenes if task.key in there):
            splits = store.read(scene, lambda log: log.frames)["split"]
            for split, count in splits.value_counts().items():
                frames[str(split)] += int(count)
        shown = drawn(known, tested, surrogates)
        maps(shown, store).write(folder)
        if plan.laid:
            grounds(plan, shown, store).write(folder)
        if tested:
            one_frame(with_detector(shown), store).write(folder)
        pictured = axis_values(shown[0], [a for a in axes if a in surrogates.columns])
        body = shown[0].grid_point.vehicle
    _about(sweep, Frames(**frames), run, pictured, body, plan).write(folder)
    (folder / FailureFrames.FILE).unlink(missing_ok=True)  # of an earlier run
    compared = failures_to_show(folder)
    if compared is not None:
        failure_frames(compared, {trial.key: trial for trial in tested}, store).write(folder)


def trials_table(plan: Plan, store: AnyStore, run: Run, axes: Sequence[str]) -> pd.DataFrame:
    """One row a trial: trial, placement, detector, seed, axes, seconds, status, error."""
    rows = []
    for trial in plan.trials:
        failure = trial_failure(trial, run.outcome.failures)
        pruned = run.promotion.pruned.get(trial.key)
        if pruned is not None:
            status, error, seconds = "pruned", pruned, np.nan
        elif failure is not None:
            status, error, seconds = "failed", failure.reason, np.nan
        else:
            status, error, seconds = "finished", "", trial_seconds(trial, store)
        row = {"seconds": seconds, "status": status, "error": error}
        rows.append(identity(trial, axes) | row)
    return pd.DataFrame(rows)


def _stack(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def _curve(trial: DetectorTrial, store: AnyStore) -> pd.DataFrame:
    curve = store.read(trial.learns, lambda training: training.curve)
    return with_columns(curve, {"trial": trial.key})


def _once(
    own: Table,
    axes: Sequence[str],
    found: Iterable[tuple[Trial, Sequence[Task], Callable[[], pd.DataFrame | None]]],
) -> pd.DataFrame:
    """One table of trials, from tasks that decide their rows; what trials share is in it once."""
    tables: dict[tuple[object, ...], pd.DataFrame | None] = {}
    by_placement = any(column.name == "placement" for column in own.columns)
    for trial, tasks, rows in found:
        columns: dict[str, Cell] = {}
        if by_placement:
            columns["placement"] = trial.grid_point.point.placement
        columns |= axis_values(trial, own.axes_of(axes))
        place = (*(task.key for task in tasks), *columns.values())
        if place not in tables:
            table = rows()
            tables[place] = None if table is None else with_columns(table, columns)
    # Trials may share some of their tasks: one that trains has the training frames besides.
    every = _stack([table for table in tables.values() if table is not None])
    return every.drop_duplicates(ignore_index=True)


def _points(trial: DetectorTrial, store: AnyStore) -> pd.DataFrame:
    """Points per object of the test frames by distance."""
    counts = [store.read(task, lambda own: own.points_per_object) for task in trial.collect_test]
    return points_by_distance(_objects(trial, store), pd.concat(counts))


def _individuals(trial: DetectorTrial, store: AnyStore) -> pd.DataFrame:
    """In how many frames of a split and a route every object counts."""
    keys = ["split", "scene", "route", "class", "object_id"]
    truths = [store.read(task, lambda truth: truth.frames) for task in trial.ground_truths]
    frames = pd.concat(truths)[["frame", "route", "split"]]
    counts = _objects(trial, store).merge(frames, on="frame").value_counts(keys)
    return counts.sort_index().reset_index(name="boxes")


def _objects(trial: DetectorTrial, store: AnyStore) -> pd.DataFrame:
    """Objects of the trial's classes that count."""
    truths = [store.read(task, lambda truth: truth.objects) for task in trial.ground_truths]
    objects = pd.concat(truths)
    return objects[objects["class"].isin(trial.grid_point.point.classes)]


def _tasks_table(tasks: Sequence[Task], store: AnyStore, run: Run) -> pd.DataFrame:
    """One row a task: columns of `TASKS`, times from the start of this run."""
    rows = []
    there = store.finished(tasks)
    for task in tasks:
        if task.key not in there:
            continue
        record = store.record(task)
        started, ended = run.outcome.times.get(task.key, (np.nan, np.nan))
        seconds = record.seconds
        if task.key in run.outcome.times:  # those before a stop were spent in another run
            seconds -= record.earlier_seconds
        rows.append(
            {
                "stage": task.stage,
                "label": task.label,
                "key": task.key,
                "seconds": seconds,
                "cached": task.key in run.cached,
                "started": started - run.started,
                "ended": ended - run.started,
                "node": record.node,
                "peak_memory": float(record.peak_memory),
                "batch_size_reduced": record.batch_size_reduced,
            }
        )
    return pd.DataFrame(rows)


def _about(
    sweep: Sweep,
    frames: Frames,
    run: Run,
    pictured: Mapping[str, Cell],
    body: Vehicle | None,
    plan: Plan,
) -> SweepResult:
    first = sweep.points[0].point
    rigs = {own.point.placement: own.rig for own in sweep.points}
    rungs = [rung.model_dump(mode="json", by_alias=True) for rung in sweep.common.promote]
    return SweepResult(
        name=sweep.common.name,
        command=hide_secrets(run.command, *sweep.common.urls),
        axes=further_axes(sweep),
        placements={n: [astuple(mount) for mount in rig.mounts] for n, rig in rigs.items()},
        lidars=lidar_models(sweep),
        classes=first.classes,
        anchors=[Anchor.model_validate(own) for own in as_plain(plan.typical)],
        colours={n: own.colour for n, own in first.class_settings.items() if own.colour},
        roi=first.voxel_roi(),
        frames=frames,
        cautions=[*plan.cautions, *rig_cautions(plan)],
        promote=[Rung.model_validate(rung) for rung in rungs],
        judge=first.judged_by,
        tracking_uri=public_url(absolute_uri(sweep.common.tracking_uri)),
        cores=run.cores,
        seconds=run.seconds,
        versions={"python": platform.python_version()} | {n: version(n) for n in _VERSIONS},
        pictured=pictured,
        vehicle=None if body is None else body.boxes.tolist(),
        vehicle_mesh=None if body is None else Triangles.of(body.mesh),
    )

"""Run folder: results of a sweep, as tables that stay readable without this project."""

import platform
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import cache, partial
from importlib.metadata import version
from operator import attrgetter
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.clouds.points_in_boxes import points_by_distance
from lidarplace.files.atomic import write_text
from lidarplace.files.secret_urls import hide_secrets, public_url
from sweeps.configuration.file import public_yaml
from sweeps.configuration.grid import GridPoint, Sweep
from sweeps.execution.execute import Outcome
from sweeps.plan.labels import further_axes
from sweeps.plan.trial import DetectorTrial, Plan, Trial, with_detector
from sweeps.results.object_tables import object_tables
from sweeps.results.pictures import drawn, grounds, maps, one_frame
from sweeps.results.promotion import Promotion
from sweeps.results.rig_cautions import rig_cautions
from sweeps.results.rigs import FILE, lidar_models, rigs_yaml
from sweeps.results.trial_results import (
    axis_values,
    identity,
    trial_failure,
    trial_seconds,
    with_columns,
)
from sweeps.stages.measure import EVALUATION_TABLES
from sweeps.stages.task import Task
from sweeps.store.local import Store
from tracking.mlflow.uri import absolute_uri
from tracking.report.analysis import Analysis
from tracking.run_folders import sweep_tables as contract
from tracking.run_folders.arrays import FailureFrames, Grounds
from tracking.run_folders.json_file import Surroundings, Triangles
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Anchor, Frames, Rung, SweepResult
from tracking.run_folders.table_schema import Cell, TableSchema
from training.typical_objects import as_plain

_OF_STAGES = (
    *("surrogates", "curves", *EVALUATION_TABLES.values()),
    *("accuracy", "sampling_error", "pog_resamples", "requirements"),
)
"""Tables of stages that a run folder has even without rows."""
_Rows = tuple[Trial, Sequence[Task], Callable[[], pd.DataFrame | None]]
"""A trial, the tasks that decide its rows of a table, and what reads these."""
_VERSIONS = ("numpy", "numba", "torch", "ray", "mlflow", "pandas")


@dataclass(frozen=True)
class Run:
    """Run of a plan.

    Attributes:
        outcome: failures and times of tasks.
        promotion: progress through the rungs.
        cached: keys of tasks that had a result before.
        cores: how many tasks could run at once, None where none ran.
        command: what the user typed.
        started: when it started, on the clock of `Outcome.times`.
        seconds: how long it took."""

    outcome: Outcome
    promotion: Promotion
    cached: Collection[str]
    cores: int | None
    command: str
    started: float
    seconds: float


def write_run(folder: Path, sweep: Sweep, plan: Plan, store: Store, run: Run) -> Analysis:
    """Gather the results of all trials into `folder`, each file renamed into place.

    Returns the analysis of the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    axes = further_axes(sweep)
    finished = store.finished(plan.tasks)
    started = [trial for trial in plan.trials if trial.surrogates.key in finished]
    complete = [trial for trial in started if all(task.key in finished for task in trial.results)]
    tested = with_detector(complete)

    objects, hits = object_tables(tested, store, axes)
    by_stage = _stage_tables(started, finished, store, axes)
    surrogates = by_stage[contract.SURROGATES.name]
    points = ((trial, trial.collect_test, partial(_points, trial, store)) for trial in tested)
    individuals = (
        (trial, trial.ground_truths, partial(_individuals, trial, store)) for trial in tested
    )
    write_text(folder / "config.yaml", public_yaml(sweep.source))
    write_text(folder / FILE, rigs_yaml(sweep))
    for table, frame in (
        (contract.TRIALS, trials_table(plan, store, run, axes)),
        (contract.POINTS, _once(contract.POINTS, axes, points)),
        (contract.INDIVIDUALS, _once(contract.INDIVIDUALS, axes, individuals)),
        (contract.OBJECTS, objects),
        (contract.FOUND, hits),
        *((_table(name), frame) for name, frame in by_stage.items()),
        (contract.PROMOTIONS, run.promotion.table()),
        (contract.TASKS, _tasks_table(plan.tasks, store, run)),
    ):
        table.write(frame, folder)
    (folder / Grounds.FILE).unlink(missing_ok=True)  # of an earlier run
    frames = Counter[str]()
    pictured: Mapping[str, Cell] = {}
    drawn_point = plan.trials[0].grid_point
    if started:
        for scene in (task for task in started[0].scenes if task.key in finished):
            frames.update(store.read(scene, lambda log: log.frames)["split"])
        drawn_trials = drawn(started, tested, surrogates)
        maps(drawn_trials, store).write(folder)
        if plan.layouts:
            grounds(plan, drawn_trials, store).write(folder)
        if tested:
            one_frame(with_detector(drawn_trials), store).write(folder)
        pictured = axis_values(drawn_trials[0], [a for a in axes if a in surrogates.columns])
        drawn_point = drawn_trials[0].grid_point
    counts = Frames(train=frames["train"], test=frames["test"])
    cautions = [*plan.cautions, *rig_cautions(plan), *_detection_cautions(tested, store)]
    _about(sweep, counts, run, pictured, drawn_point, plan, cautions).write(folder)
    (folder / FailureFrames.FILE).unlink(missing_ok=True)  # of an earlier run
    return Analysis(RunFolder.read(folder))


@cache
def _table(name: str) -> TableSchema:
    """Return the table of a run folder; one that only a new stage knows has placement and axes."""
    by_name = {table.name: table for table in contract.TABLES}
    return by_name.get(name) or TableSchema.of(
        name, "a row of a stage", contract.PLACEMENT, axes=("",)
    )


def _stage_tables(
    trials: Sequence[Trial], finished: Collection[str], store: Store, axes: Sequence[str]
) -> dict[str, pd.DataFrame]:
    """Return the tables that results of stages hold, by name.

    A table of trials gets the rows of those of which all results are there."""
    rows: dict[str, list[_Rows]] = {name: [] for name in _OF_STAGES}
    for trial in trials:
        whole = all(task.key in finished for task in trial.results)
        for task in dict.fromkeys(trial.results):
            for field, name in task.stage.tables.items():
                if task.key in finished and (whole or not _has(_table(name), "trial")):
                    read = partial(store.read, task, attrgetter(field))
                    rows.setdefault(name, []).append((trial, (task,), read))
    for name, of_table in rows.items():
        if not _has(_table(name), "trial"):
            of_table.sort(key=lambda row: row[1][0].stage.order)
    return {name: _once(_table(name), axes, of_table) for name, of_table in rows.items()}


def trials_table(plan: Plan, store: Store, run: Run, axes: Sequence[str]) -> pd.DataFrame:
    """Make one row a trial: trial, placement, detector, seed, axes, seconds, status, error."""
    rows = []
    for trial in plan.trials:
        row: dict[str, Cell] = {"seconds": np.nan, "status": "finished", "error": ""}
        if trial.key in run.promotion.pruned:
            row |= {"status": "pruned", "error": run.promotion.pruned[trial.key]}
        elif failure := trial_failure(trial, run.outcome.failures):
            row |= {"status": "failed", "error": failure.reason}
        else:
            row["seconds"] = trial_seconds(trial, store)
        rows.append(identity(trial, axes) | row)
    return pd.DataFrame(rows)


def _detection_cautions(trials: Sequence[DetectorTrial], store: Store) -> list[str]:
    """Return the cautions about the detections of commands, each command once."""
    learnt = {trial.learns.key: trial.learns for trial in trials}
    commands = [task for task in learnt.values() if task.stage.name == "command"]
    return [text for task in commands for text in store.read(task, attrgetter("cautions"))]


def _stack(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def _once(table: TableSchema, axes: Sequence[str], rows: Iterable[_Rows]) -> pd.DataFrame:
    """Stack rows of trials, with columns that distinguish them in front; shared rows once."""
    parts: dict[tuple[object, ...], pd.DataFrame | None] = {}
    for trial, tasks, read in rows:
        columns = {name: v for name, v in identity(trial, ()).items() if _has(table, name)}
        columns |= axis_values(trial, table.axes_of(axes))
        place = (*(task.key for task in tasks), *columns.values())
        if place not in parts:
            part = read()
            parts[place] = None if part is None else with_columns(part, columns)
    every = _stack([part for part in parts.values() if part is not None])
    # Trials may share some of their tasks: one that trains has the training frames, too.
    return every if _has(table, "trial") else every.drop_duplicates(ignore_index=True)


def _has(table: TableSchema, name: str) -> bool:
    return any(column.name == name for column in table.columns)


def _points(trial: DetectorTrial, store: Store) -> pd.DataFrame:
    counts = [store.read(task, lambda own: own.points_per_object) for task in trial.collect_test]
    return points_by_distance(_objects(trial, store), pd.concat(counts))


def _individuals(trial: DetectorTrial, store: Store) -> pd.DataFrame:
    """Count the frames of a split and a route in which every object counts."""
    keys = ["split", "scene", "route", "class", "object_id"]
    truths = [store.read(task, lambda truth: truth.frames) for task in trial.ground_truths]
    frames = pd.concat(truths)[["frame", "route", "split"]]
    counts = _objects(trial, store).merge(frames, on="frame").value_counts(keys)
    return counts.sort_index().reset_index(name="boxes")


def _objects(trial: DetectorTrial, store: Store) -> pd.DataFrame:
    truths = [store.read(task, lambda truth: truth.objects) for task in trial.ground_truths]
    objects = pd.concat(truths)
    return objects[objects["class"].isin(trial.grid_point.point.classes)]


def _tasks_table(tasks: Sequence[Task], store: Store, run: Run) -> pd.DataFrame:
    rows, finished = [], store.finished(tasks)
    for task in (task for task in tasks if task.key in finished):
        record = store.record(task)
        started, ended = run.outcome.times.get(task.key, (np.nan, np.nan))
        seconds = record.seconds
        if task.key in run.outcome.times:  # those before a stop were spent in another run
            seconds -= record.earlier_seconds
        rows.append(
            {
                "stage": task.stage.name,
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
    drawn_point: GridPoint,
    plan: Plan,
    cautions: Sequence[str],
) -> SweepResult:
    first, body = sweep.points[0].point, drawn_point.vehicle
    rigs = {one.point.placement: one.rig for one in sweep.points}
    rungs = (rung.model_dump(mode="json", by_alias=True) for rung in sweep.common.promote)
    return SweepResult(
        name=sweep.common.name,
        command=hide_secrets(run.command, *sweep.common.urls),
        axes=further_axes(sweep),
        placements={n: [astuple(mount) for mount in rig.mounts] for n, rig in rigs.items()},
        lidars=lidar_models(sweep),
        classes=first.classes,
        anchors=[Anchor.model_validate(size) for size in as_plain(plan.typical)],
        colours={
            n: setting.colour for n, setting in first.class_settings.items() if setting.colour
        },
        roi=first.voxel_roi(),
        frames=frames,
        cautions=cautions,
        promote=[Rung.model_validate(rung) for rung in rungs],
        evaluator=first.evaluator_name,
        tracking_uri=public_url(absolute_uri(sweep.common.tracking_uri)),
        cores=run.cores,
        seconds=run.seconds,
        versions={"python": platform.python_version()} | {n: version(n) for n in _VERSIONS},
        pictured=pictured,
        vehicle=None if body is None else body.boxes.tolist(),
        vehicle_mesh=None if body is None else Triangles.of(body.mesh),
        site=Surroundings.of(drawn_point.poles),
    )

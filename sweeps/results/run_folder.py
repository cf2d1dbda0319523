"""Run folder: results of a sweep, as tables that stay readable without this project."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import partial
from importlib.metadata import version
from operator import attrgetter
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
from sweeps.store.local import Store
from sweeps.tasks.task import Task
from tracking.mlflow.uri import absolute_uri
from tracking.report.analysis import Analysis
from tracking.run_folders import sweep_tables as contract
from tracking.run_folders.arrays import Grounds
from tracking.run_folders.json_file import Triangles
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Anchor, Frames, Rung, SweepResult
from tracking.run_folders.table import Table
from training.typical_objects import as_plain

OF_EVALUATION = {
    contract.RESULTS: "metrics",
    contract.PR_CURVES: "pr_curves",
    contract.LEFT_OUT: "left_out",
    contract.DISTANCE: "by_distance",
    contract.SECTOR: "by_sector",
}
"""Tables that are fields of `Evaluated`."""
_OF_STAGE = {
    contract.ACCURACY: ("accuracy", "table"),
    contract.SAMPLING_ERROR: ("sampling_error", "estimates"),
    contract.POG_RESAMPLES: ("sampling_error", "resamples"),
    contract.REQUIREMENTS: ("requirements", "table"),
}
"""Tables that are fields of the result of one of a trial's tasks."""
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

    Returns the analysis of the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    axes = further_axes(sweep)
    there = store.finished(plan.tasks)
    known = [trial for trial in plan.trials if trial.surrogates.key in there]
    good = [trial for trial in known if all(task.key in there for task in trial.results)]
    tested = with_detector(good)

    def of_stage(own: Table, task_of: str, field: str) -> pd.DataFrame:
        """One table of a stage."""
        tasks = ((trial, getattr(trial, task_of)) for trial in known)
        read = attrgetter(field)
        there_of = (
            (trial, (task,), partial(store.read, task, read))
            for trial, task in tasks
            if task is not None and task.key in there
        )
        return _once(own, axes, there_of)

    def of_evaluation(field: str) -> pd.DataFrame:
        """One table of the evaluations."""
        return _stack([trial_results(own, store, axes, attrgetter(field)) for own in tested])

    objects, found = object_tables(tested, store, axes)
    scored = [of_stage(contract.SURROGATES, stage, "table") for stage in ("surrogates", "recall")]
    surrogates = _stack(scored)
    points = ((own, own.collect_test, partial(_points, own, store)) for own in tested)
    individuals = ((own, own.ground_truths, partial(_individuals, own, store)) for own in tested)
    curves = [
        with_columns(store.read(own.finetune, lambda training: training.curve), {"trial": own.key})
        for own in tested
        if own.finetune is not None
    ]
    write_text(folder / "config.yaml", public_yaml(sweep.source))
    write_text(folder / FILE, rigs_yaml(sweep))
    for table, frame in (
        (contract.TRIALS, trials_table(plan, store, run, axes)),
        (contract.SURROGATES, surrogates),
        (contract.CURVES, _stack(curves)),
        (contract.POINTS, _once(contract.POINTS, axes, points)),
        (contract.INDIVIDUALS, _once(contract.INDIVIDUALS, axes, individuals)),
        (contract.OBJECTS, objects),
        (contract.FOUND, found),
        *((own, of_evaluation(field)) for own, field in OF_EVALUATION.items()),
        *((own, of_stage(own, *where)) for own, where in _OF_STAGE.items()),
        (contract.PROMOTIONS, run.promotion.table()),
        (contract.TASKS, _tasks_table(plan.tasks, store, run)),
    ):
        table.write(frame, folder)
    (folder / Grounds.FILE).unlink(missing_ok=True)  # of an earlier run
    frames = Counter[str]()
    pictured: Mapping[str, Cell] = {}
    body = plan.trials[0].grid_point.vehicle
    if known:
        for scene in (task for task in known[0].scenes if task.key in there):
            frames.update(store.read(scene, lambda log: log.frames)["split"])
        shown = drawn(known, tested, surrogates)
        maps(shown, store).write(folder)
        if plan.laid:
            grounds(plan, shown, store).write(folder)
        if tested:
            one_frame(with_detector(shown), store).write(folder)
        pictured = axis_values(shown[0], [a for a in axes if a in surrogates.columns])
        body = shown[0].grid_point.vehicle
    counts = Frames(train=frames["train"], test=frames["test"])
    cautions = [*plan.cautions, *rig_cautions(plan), *_detection_cautions(tested, store)]
    _about(sweep, counts, run, pictured, body, plan, cautions).write(folder)
    return Analysis(RunFolder.read(folder))


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
    commands = [task for task in learnt.values() if task.stage == "command"]
    return [text for task in commands for text in store.read(task, attrgetter("cautions"))]


def _stack(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def _once(
    own: Table,
    axes: Sequence[str],
    found: Iterable[tuple[Trial, Sequence[Task], Callable[[], pd.DataFrame | None]]],
) -> pd.DataFrame:
    """Make one table of trials from tasks that decide their rows; shared rows are in it once."""
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
    rows, there = [], store.finished(tasks)
    for task in (task for task in tasks if task.key in there):
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
    cautions: Sequence[str],
) -> SweepResult:
    first = sweep.points[0].point
    rigs = {own.point.placement: own.rig for own in sweep.points}
    rungs = (rung.model_dump(mode="json", by_alias=True) for rung in sweep.common.promote)
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
    )

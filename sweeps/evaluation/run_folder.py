"""The run folder of detections from elsewhere, in the format of a sweep's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.command_line.invocation import called
from lidarplace.files.atomic import write_text
from lidarplace.files.regular import is_there
from sweeps.configuration.file import public_yaml
from sweeps.evaluation.request import EvaluationRequest
from sweeps.results.failure_frames import frames_of
from sweeps.results.object_tables import ABOUT, found_in
from sweeps.results.trial_results import with_columns
from sweeps.stages.measure import EVALUATION_TABLES, EvaluationResult, evaluate_detections
from tracking.report.analysis import Analysis
from tracking.run_folders import sweep_tables as contract
from tracking.run_folders.arrays import FailureFrames
from tracking.run_folders.json_file import Triangles
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Frames, SweepResult
from tracking.run_folders.table_schema import Cell

DETECTOR = "own"
"""Name of the detector in tables."""

Results = Mapping[str, Sequence[EvaluationResult]]
"""Results of the detections of a rig, by its name and by training."""


def evaluate_rigs(request: EvaluationRequest) -> Results:
    """Compare the detections of every rig with the objects that count."""
    test = request.test

    def evaluated(boxes: pd.DataFrame) -> EvaluationResult:
        return evaluate_detections(test.objects, boxes, test.routes, test.classes, {})

    return {name: list(map(evaluated, trainings)) for name, trainings in request.rigs.items()}


def results_of(results: Results) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the tables `results` and `left_out` of a run folder."""
    return _stack(results, "metrics"), _stack(results, "left_out")


def _trials(results: Results) -> list[tuple[dict[str, Cell], EvaluationResult]]:
    return [
        ({"trial": f"{name}/{seed}", "placement": name, "detector": DETECTOR, "seed": seed}, result)
        for name, trainings in results.items()
        for seed, result in enumerate(trainings)
    ]


def _stack(results: Results, field: str) -> pd.DataFrame:
    tables = [with_columns(getattr(result, field), place) for place, result in _trials(results)]
    return pd.concat(tables, ignore_index=True)


def check_free(folder: Path) -> None:
    """Raise InputError if the folder is that of a sweep, whose results would be lost."""
    if is_there(folder / "sweep.json") and not SweepResult.read(folder).detections:
        fix = "name another one with --out"
        raise InputError("is the run folder of a sweep", place=str(folder), fix=fix)


def write_evaluation(
    folder: Path, results: Results, request: EvaluationRequest, evaluator: str
) -> tuple[Analysis, FailureFrames | None]:
    """Write all that reports read; return the analysis of the folder and the frames to show.

    The evaluator is "generalist" if one network made all detections."""
    test, vehicle = request.test, request.vehicle
    folder.mkdir(parents=True, exist_ok=True)
    trials = _trials(results)
    objects = test.objects.merge(test.routes[["frame", "route"]], on="frame")[list(ABOUT)]
    objects.insert(0, "object", np.arange(len(objects)))
    keys = ["split", "scene", "route", "class", "object_id"]
    individuals = objects.merge(test.routes[["frame", "split"]], on="frame").value_counts(keys)
    write_text(
        folder / "config.yaml", public_yaml({"command": called(), "notes": [*request.notes]})
    )
    tables = {table.name: table for table in contract.TABLES}
    for field, name in EVALUATION_TABLES.items():
        tables[name].write(_stack(results, field), folder)
    contract.FOUND.write(pd.concat([_found(objects, *trial) for trial in trials]), folder)
    contract.SURROGATES.write(pd.DataFrame(), folder)
    contract.OBJECTS.write(objects, folder)
    contract.INDIVIDUALS.write(individuals.sort_index().reset_index(name="boxes"), folder)
    finished = {"seconds": np.nan, "status": "finished", "error": ""}
    contract.TRIALS.write(pd.DataFrame([place | finished for place, _ in trials]), folder)
    placements = {name: tuple(map(astuple, rig.mounts)) for name, rig in request.geometry.items()}
    SweepResult(
        name=folder.name,
        command=called(),
        axes=(),
        placements={name: placements.get(name, ()) for name in results},
        classes=test.classes,
        roi=test.roi,
        frames=Frames(train=0, test=len(test.log.frames)),
        cautions=tuple(request.cautions),
        evaluator=evaluator,
        detections={name: tuple(paths) for name, paths in request.paths.items()},
        vehicle=None if vehicle is None else vehicle.boxes.tolist(),
        vehicle_mesh=None if vehicle is None else Triangles.of(vehicle.mesh),
    ).write(folder)
    (folder / FailureFrames.FILE).unlink(missing_ok=True)  # of an earlier run
    analysis, frames = Analysis(RunFolder.read(folder)), None
    if analysis.pair is not None:
        boxes = {str(place["trial"]): result.detections for place, result in trials}
        none = np.zeros((0, 4), np.float32)
        frames = frames_of(analysis.pair, boxes, lambda trial, frame: none)
        frames.write(folder)
    return analysis, frames


def _found(
    objects: pd.DataFrame, place: Mapping[str, Cell], result: EvaluationResult
) -> pd.DataFrame:
    """Return whether each object was found; the number of its points is not known."""
    hit = found_in(objects, result.detections)
    return pd.DataFrame({"trial": place["trial"], "object": objects["object"], "found": hit})

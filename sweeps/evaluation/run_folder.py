"""The run folder of detections from elsewhere, which reports read as that of a sweep."""

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
from sweeps.results.trial_results import Cell, with_columns
from sweeps.stages.evaluate import EVALUATION_TABLES, EvaluationResult, evaluate_detections
from tracking.report.analysis import Analysis
from tracking.run_folders import sweep_tables as contract
from tracking.run_folders.arrays import FailureFrames
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Frames, SweepResult

DETECTOR = "own"
"""What tables call the detector that made them."""

Worth = Mapping[str, Sequence[EvaluationResult]]
"""What the detections of a rig are worth, by its name and by training."""


def evaluate_rigs(asked: EvaluationRequest) -> Worth:
    """Compare the detections of every rig with the objects that count."""
    test = asked.test
    return {
        name: [
            evaluate_detections(test.objects, own, test.routes, test.classes, {}) for own in seeds
        ]
        for name, seeds in asked.rigs.items()
    }


def results_of(found: Worth) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables `results` and `left_out` of a run folder."""
    return _stack(found, "metrics"), _stack(found, "left_out")


def _trials(found: Worth) -> list[tuple[dict[str, Cell], EvaluationResult]]:
    return [
        ({"trial": f"{name}/{seed}", "placement": name, "detector": DETECTOR, "seed": seed}, own)
        for name, seeds in found.items()
        for seed, own in enumerate(seeds)
    ]


def _stack(found: Worth, field: str) -> pd.DataFrame:
    tables = [with_columns(getattr(own, field), place) for place, own in _trials(found)]
    return pd.concat(tables, ignore_index=True)


def check_free(folder: Path) -> None:
    """Raise InputError if the folder is that of a sweep, whose results would be lost."""
    if is_there(folder / "sweep.json") and not SweepResult.read(folder).detections:
        fix = "name another one with --out"
        raise InputError("is the run folder of a sweep", place=str(folder), fix=fix)


def write_evaluation(
    folder: Path, found: Worth, asked: EvaluationRequest, evaluator: str
) -> tuple[Analysis, FailureFrames | None]:
    """Write all that reports read; return the analysis of the folder and the frames to show.

    The evaluator is "generalist" if one network made all detections.
    """
    test = asked.test
    folder.mkdir(parents=True, exist_ok=True)
    trials = _trials(found)
    objects = test.objects.merge(test.routes[["frame", "route"]], on="frame")[list(ABOUT)]
    objects.insert(0, "object", np.arange(len(objects)))
    keys = ["split", "scene", "route", "class", "object_id"]
    individuals = objects.merge(test.routes[["frame", "split"]], on="frame").value_counts(keys)
    write_text(folder / "config.yaml", public_yaml({"command": called(), "notes": [*asked.notes]}))
    tables = {table.name: table for table in contract.TABLES}
    for field, name in EVALUATION_TABLES.items():
        tables[name].write(_stack(found, field), folder)
    contract.FOUND.write(pd.concat([_found(objects, own, place) for place, own in trials]), folder)
    contract.SURROGATES.write(pd.DataFrame(), folder)
    contract.OBJECTS.write(objects, folder)
    contract.INDIVIDUALS.write(individuals.sort_index().reset_index(name="boxes"), folder)
    finished = {"seconds": np.nan, "status": "finished", "error": ""}
    contract.TRIALS.write(pd.DataFrame([place | finished for place, _ in trials]), folder)
    mounts = {name: asked.geometry[name].mounts if name in asked.geometry else () for name in found}
    SweepResult(
        name=folder.name,
        command=called(),
        axes=(),
        placements={name: tuple(map(astuple, own)) for name, own in mounts.items()},
        classes=test.classes,
        roi=test.roi,
        frames=Frames(train=0, test=len(test.log.frames)),
        cautions=tuple(asked.cautions),
        evaluator=evaluator,
        detections={name: tuple(own) for name, own in asked.paths.items()},
    ).write(folder)
    (folder / FailureFrames.FILE).unlink(missing_ok=True)  # of an earlier run
    analysis, frames = Analysis(RunFolder.read(folder)), None
    if analysis.pair is not None:
        boxes = {str(place["trial"]): own.detections for place, own in trials}
        none = np.zeros((0, 4), np.float32)
        frames = frames_of(analysis.pair, boxes, lambda trial, frame: none)
        frames.write(folder)
    return analysis, frames


def _found(objects: pd.DataFrame, own: EvaluationResult, place: Mapping[str, Cell]) -> pd.DataFrame:
    """Whether each object was found; how many points were on it is not known."""
    hit = found_in(objects, own.detections)
    return pd.DataFrame({"trial": place["trial"], "object": objects["object"], "found": hit})

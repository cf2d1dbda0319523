"""Predictions of the rigs: by surrogates, generalists, and functions of one's own."""

import json
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError, at
from lidarplace.base.foreign_code import finite_number
from lidarplace.base.registry import PluginError, Registry
from lidarplace.base.suggestions import did_you_mean
from lidarplace.logs.box_log import BoxLog
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, SURROGATES, Surrogate
from lidarplace.rigs.placement import Placement
from sweeps.benchmark.rigs import METRICS, log_of, of, trials
from sweeps.plan.trial import DetectorTrial, Trial, with_detector
from sweeps.stages.evaluate import EvaluateStage
from sweeps.stages.train import TrainedDetector
from training.settings import PRETRAINED

Function = Callable[[Placement, BoxLog], float | Mapping[str, float]]
"""Function that rates a rig, high for good ones.

Returns one number, or one for each of "Car", "Cyclist", "Pedestrian" and "all". The log has the
frames to train on."""

FUNCTIONS: Registry[Function] = Registry(
    "lidarplace.predictors", {}, fits=lambda found: callable(found) or isinstance(found, Surrogate)
)
"""Predictors of plug-ins."""

_SAME = ("ig", "residual_entropy")  # as S-MIG, the order of the rigs
BUILT_IN = tuple(
    name for name, surrogate in SURROGATES.own.items() if not surrogate.fixed and name not in _SAME
)
"""Surrogates of the tables."""

_Every = Callable[[Iterable[str]], Iterable[str]]
OfRig = Callable[[Trial], Mapping[str, float]]


def predict(predictor: str, every: _Every = iter) -> tuple[pd.DataFrame, float]:
    """Predict the results of all rigs, a row a rig, a column for each of `METRICS`.

    NaN where a predictor has no value. Returns also seconds of a rig, without what is done once
    for all. `every` goes over the rigs' names, and may show progress. Raises InputError,
    OSError: there is no such predictor, or it fails, gives what is no finite number or the same
    for all rigs."""
    of_rig, rigs = resolved(predictor)
    values, seconds = {}, []
    for rig in every(rigs):
        start = time.perf_counter()
        values[rig] = of_rig(rigs[rig])
        seconds.append(time.perf_counter() - start)
    table = pd.DataFrame.from_dict(values, orient="index")[list(METRICS)]
    if (table.nunique() < 2).all():
        raise InputError("the same number for all rigs", place=predictor)
    # The first rig waits for compilers and for what is made once.
    return table, float(np.mean(seconds[1:]))


def resolved(predictor: str) -> tuple[OfRig, Mapping[str, Trial]]:
    """Return a function of the values of a rig by `METRICS`, and the rigs. Raises as `predict`."""
    path = Path(predictor)
    if path == PRETRAINED or path.suffix in (".pt", ".pth") or path.is_file():
        return _generalist(path)
    try:
        registry: Registry[Any] = SURROGATES if predictor in SURROGATES.own else FUNCTIONS
        predictor_found = registry[predictor]
    except PluginError as error:
        hint = f"{error}{did_you_mean(predictor, SURROGATES.own)}"
        names = (*SURROGATES.own, PRETRAINED, "a checkpoint (.pt), or module:function")
        expected = ", ".join(map(str, names))
        raise InputError(hint, place="predictor", expected=expected) from None
    if isinstance(predictor_found, Surrogate):
        return _surrogate(predictor, predictor_found)
    # Rigs with as many azimuth steps as their clouds have.
    return partial(_of_function, predictor, predictor_found), trials(
        ["surrogate.names=[log_points]"]
    )


def _surrogate(name: str, surrogate: Surrogate) -> tuple[OfRig, Mapping[str, Trial]]:
    rigs = trials([f"surrogate.names=['{surrogate.beside or name}']"])
    scene: Any = log_of("train")
    if name not in OBJECT_SURROGATES:
        scene = next(iter(rigs.values())).pog.stage.run(scene)

    def of_rig(trial: Trial) -> Mapping[str, float]:
        task = trial.score_by(name)
        table = task.stage.run(scene).table
        table = table[table["surrogate"] == name]
        by_class = dict(zip(table["class"], table["value"], strict=True))
        by_class["all"] = table["value"].sum(skipna=False) if surrogate.additive else np.nan
        return _by_metric(by_class)

    return of_rig, rigs


def _of_function(name: str, function: Function, trial: Trial) -> Mapping[str, float]:
    assert trial.recall is not None
    (rig,) = trial.recall.stage.rigs
    place = f"{name}: rig {rig.name}"
    with FUNCTIONS.calls(place):
        result = function(rig, log_of("train"))
        by_class = dict(result) if isinstance(result, Mapping) else dict.fromkeys(_CLASSES, result)
    for key in by_class:
        if key not in _CLASSES:
            expected = f"a number, or one for each of {', '.join(_CLASSES)}"
            raise InputError(place=place, key="result", expected=expected, found=f"{key!r}")
    return _by_metric({k: finite_number(value, f"{place}: {k}") for k, value in by_class.items()})


_CLASSES = tuple(dict.fromkeys(name for name, _, _ in METRICS.values()))


def _by_metric(by_class: Mapping[str, float]) -> dict[str, float]:
    return {metric: by_class.get(name, np.nan) for metric, (name, _, _) in METRICS.items()}


def _generalist(path: Path) -> tuple[OfRig, Mapping[str, Trial]]:
    """Compute AP and recall of detections in the test frames, with the study's mounting errors."""
    from sweeps.search.trials.by_generalist import detect_task
    from training import build_detector
    from training.checkpoints import load_checkpoint, read_checkpoint
    from training.kitti_ap import evaluation

    content, _ = read_checkpoint(path)
    if not isinstance(detector := content.get("detector"), str):
        fix = "write it with training.checkpoints.write_checkpoint"
        raise InputError("the checkpoint does not name its detector", place=str(path), fix=fix)
    named = {"detector": detector, "training.checkpoint": str(path)}
    with at(path):
        rigs = trials([f"{key}={json.dumps(value)}" for key, value in named.items()])
    first = with_detector(rigs.values())[0].evaluate.stage
    assert isinstance(first, EvaluateStage)
    model = build_detector(
        detector, first.classes, point_range=first.point_range, typical=first.typical
    )
    load_checkpoint(model, path)
    no_curve = pd.DataFrame(columns=["epoch", "metric", "value"])
    weights = TrainedDetector(
        model.state_dict(), no_curve, list(first.classes), 1, False, str(path), 0.0
    )
    log = log_of("test")

    def of_rig(trial: Trial) -> Mapping[str, float]:
        assert isinstance(trial, DetectorTrial)
        detected = detect_task(trial.evaluate, 0, 1).stage.run(weights, log)
        (truth,) = (task.stage.run(log) for task in trial.ground_truths)
        frames = detected.frames["frame"].tolist()
        table = evaluation(truth.objects, detected.detections, frames, first.classes).metrics
        return {metric: float(of(table, metric)["value"].iloc[0]) for metric in METRICS}

    return of_rig, rigs

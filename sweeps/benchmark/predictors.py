"""What predictors say of the rigs: surrogates, generalists, and functions of one's own."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.base.registry import PluginError, Registry
from lidarplace.base.suggestions import did_you_mean
from lidarplace.logs.box_log import BoxLog
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, SURROGATES, Surrogate
from lidarplace.rigs.placement import Placement
from sweeps.benchmark.peers.expected_ap import expected_ap
from sweeps.benchmark.peers.ground_points import density, uniformity
from sweeps.benchmark.peers.perception_entropy import perception_entropy
from sweeps.benchmark.rigs import METRICS, log_of, of, trials
from sweeps.plan.trial import DetectorTrial, Trial, with_detector
from sweeps.tasks import stages
from sweeps.tasks.results import Trained

Function = Callable[[Placement, BoxLog], float | Mapping[str, float]]
"""A number of a rig, high for good ones; or one for each of "Car", "Cyclist", "Pedestrian" and
"all". The log has the frames to train on."""

FUNCTIONS: Registry[Function] = Registry(
    "lidarplace.predictors",
    {
        "perception_entropy": perception_entropy,
        "expected_ap": expected_ap,
        "ground_density": density,
        "ground_uniformity": uniformity,
    },
    fits=lambda found: callable(found) or isinstance(found, Surrogate),
)
"""Predictors of other groups, and those of plug-ins."""

BUILT_IN = (
    *(
        n
        for n, own in SURROGATES.own.items()
        if not own.fixed and n not in ("ig", "residual_entropy")
    ),
    *FUNCTIONS.own,
)
"""All; IG and residual entropy order rigs as S-MIG does."""

_Every = Callable[[Iterable[str]], Iterable[str]]


@dataclass(frozen=True, eq=False)
class Predicted:
    """What a predictor says.

    Attributes:
        name: its own.
        values: a row a rig, a column for each of `METRICS`; NaN where it has no value.
        seconds: of a rig, without what is done once for all.
    """

    name: str
    values: pd.DataFrame
    seconds: float

    def table(self) -> pd.DataFrame:
        """Rows of the table "predicted" of the package."""
        named = self.values.rename_axis("placement").reset_index()
        return named.assign(predictor=self.name, seconds=self.seconds)


def predict(predictor: str, every: _Every = lambda rigs: rigs) -> Predicted:
    """What a predictor says of all rigs.

    Args:
        predictor: a surrogate or another name, a checkpoint of a generalist, or `module:function`.
        every: goes over the names of the rigs, and may show how far it is.

    Raises:
        InputError: there is no such predictor, it fails, it gives no finite number, or the same
            number for all rigs.
    """
    of_rig, rigs = _resolved(predictor)
    values, seconds = {}, []
    for rig in every(rigs):
        start = time.perf_counter()
        values[rig] = of_rig(rigs[rig])
        seconds.append(time.perf_counter() - start)
    table = pd.DataFrame.from_dict(values, orient="index")[list(METRICS)]
    if (table.nunique() < 2).all():
        raise InputError(
            "the same number for all rigs",
            place=predictor,
            expected="numbers that differ",
            found=f"{table.iloc[0].dropna().iloc[0]:g}",
        )
    # The first rig waits for compilers and for what is made once.
    return Predicted(predictor, table, float(np.mean(seconds[1:])))


def _resolved(predictor: str) -> tuple[Callable[[Trial], Mapping[str, float]], Mapping[str, Trial]]:
    path = Path(predictor)
    if path.suffix in (".pt", ".pth") or path.is_file():
        return _generalist(path)
    try:
        if predictor in SURROGATES.own:
            found: Function | Surrogate = SURROGATES[predictor]
        else:
            found = FUNCTIONS[predictor]
    except PluginError as error:
        if ":" in predictor:
            raise InputError(str(error), place="predictor") from None
        names = [*SURROGATES.own, *FUNCTIONS.own]
        raise InputError(
            f"unknown predictor {predictor!r}{did_you_mean(predictor, names)}",
            expected=f"{', '.join(names)}, a checkpoint (.pt), or module:function",
        ) from None
    if isinstance(found, Surrogate):
        return _surrogate(predictor, found)

    def called(trial: Trial) -> Mapping[str, float]:
        return _of_function(predictor, found, trial)

    # Rigs with as many azimuth steps as their clouds have.
    return called, trials(["surrogate.names=[log_points]"])


def _surrogate(
    name: str, own: Surrogate
) -> tuple[Callable[[Trial], Mapping[str, float]], Mapping[str, Trial]]:
    rigs = trials([f"surrogate.names=['{own.beside or name}']"])
    log, pog = log_of("train"), None
    if name not in OBJECT_SURROGATES:
        pog = stages.pog(next(iter(rigs.values())).pog.params, log)

    def of_rig(trial: Trial) -> Mapping[str, float]:
        if pog is not None:
            table = stages.surrogates(trial.surrogates.params, pog).table
        else:
            assert trial.recall is not None
            table = stages.recall(trial.recall.params, log).table
        table = table[table["surrogate"] == name]
        by_class = dict(zip(table["class"], table["value"], strict=True))
        by_class["all"] = table["value"].sum(skipna=False) if own.additive else np.nan
        return _by_metric(by_class)

    return of_rig, rigs


def _of_function(name: str, function: Function, trial: Trial) -> Mapping[str, float]:
    assert trial.recall is not None
    rig = trial.recall.params.placement
    try:
        found = function(rig, log_of("train"))
        by_class = dict(found) if isinstance(found, Mapping) else dict.fromkeys(_CLASSES, found)
        numbers = {key: float(value) for key, value in by_class.items()}
    except Exception as error:  # of the user's own code
        at = traceback.extract_tb(error.__traceback__)[-1]
        why = " ".join(f"{type(error).__name__}: {error}".split())
        place = f"{name}: rig {rig.name}"
        raise InputError(
            f"{why} ({Path(at.filename).name}, line {at.lineno})", place=place
        ) from None
    for key, value in numbers.items():
        if key not in _CLASSES or not np.isfinite(value):
            raise InputError(
                "wrong result",
                place=f"{name}: rig {rig.name}",
                expected=f"a finite number, or one for each of {', '.join(_CLASSES)}",
                found=f"{key}: {value}",
            )
    return _by_metric(numbers)


_CLASSES = tuple(dict.fromkeys(name for name, _, _ in METRICS.values()))


def _by_metric(by_class: Mapping[str, float]) -> dict[str, float]:
    return {metric: by_class.get(name, np.nan) for metric, (name, _, _) in METRICS.items()}


def _generalist(path: Path) -> tuple[Callable[[Trial], Mapping[str, float]], Mapping[str, Trial]]:
    """AP and recall of detections in the test frames, with the mounting errors of the study."""
    from sweeps.search.trials.by_generalist import judge_task
    from training import build_detector
    from training.checkpoints import load_checkpoint, read_checkpoint
    from training.kitti_ap import evaluation

    content, _ = read_checkpoint(path)
    if not isinstance(detector := content.get("detector"), str):
        raise InputError(
            "the checkpoint does not name its detector",
            place=str(path),
            fix="write it with lidarplace pretrain, or with training.checkpoints.write_checkpoint",
        )
    rigs = trials([f"detector={detector}", f"training.checkpoint={path.absolute()}"])
    first = with_detector(rigs.values())[0].evaluate.params
    model = build_detector(
        detector, first.classes, point_range=first.point_range, typical=first.typical
    )
    load_checkpoint(model, path)
    no_curve = pd.DataFrame(columns=["epoch", "metric", "value"])
    weights = Trained(model.state_dict(), no_curve, list(first.classes), 1, False, str(path), 0.0)
    log = log_of("test")

    def of_rig(trial: Trial) -> Mapping[str, float]:
        assert isinstance(trial, DetectorTrial)
        found = stages.judge(judge_task(trial.evaluate, 0, 1).params, weights, log)
        (truth,) = (stages.ground_truth(task.params, log) for task in trial.ground_truths)
        table = evaluation(
            truth.objects, found.detections, found.frames["frame"].tolist(), first.classes
        ).metrics
        return {metric: float(of(table, metric)["value"].iloc[0]) for metric in METRICS}

    return of_rig, rigs

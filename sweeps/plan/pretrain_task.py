"""The training of a base checkpoint on the clouds of many rigs, in one scene or several."""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Crop
from sweeps.configuration.grid import Sweep
from sweeps.plan.trial import Plan, with_detector
from sweeps.stages.train import FinetuneStage, PretrainStage
from sweeps.stages.train import TrainedDetector
from sweeps.stages.task import Task

_MIXED = ("placement", "lidar", "vehicle", "mounting_errors", "seed", "surrogate")
"""Axes that may have several values: those of the rig are mixed, the others do not matter."""


def training_of(sweep: Sweep, plan: Plan) -> Task[TrainedDetector]:
    """A training on the clouds of all placements of a sweep, with the seed of its first point.
    Raises InputError: no detector, or several, or trainings, scenes, ROIs, lists of classes."""
    for axis in sweep.axes:
        # A value may be a list or a mapping.
        values = {repr(grid_point.axes[axis]) for grid_point in sweep.points}
        if axis.partition(".")[0] not in _MIXED and len(values) > 1:
            key, fix = f"grid.{axis}", f"choose with --set 'grid.{axis}=[…]'"
            every = ", ".join(sorted(values))
            raise InputError("a base is trained for one value", key=key, found=every, fix=fix)
    found = [trial.finetune for trial in with_detector(plan.trials)]
    trainings = [training for training in found if training is not None]
    if not trainings:
        fix = "name the detector of the base"
        raise InputError("null or a command trains nothing", key="detector", fix=fix)
    inputs = {needed.key: needed for training in trainings for needed in training.inputs}
    params = trainings[0].stage
    params = replace(params, point_range=_around([own.stage.point_range for own in trainings]))
    return Task("pretrain", params.detector, params, tuple(inputs.values()))


def pretrain_task(trainings: Sequence[Task[TrainedDetector]]) -> Task[TrainedDetector]:
    """One training on the clouds of several, of sweeps or of the generalists of searches, with the
    network and the settings that they share. Raises InputError: they differ in these."""
    every = [training.stage for training in trainings]
    for name in ("detector", "classes", "training", "typical", "seed"):
        values = {repr(getattr(params, name)) for params in every}
        if len(values) > 1:
            found, expected = " and ".join(sorted(values)), "one network for all configurations"
            raise InputError(key=name, expected=expected, found=found)
    same = {own.name: getattr(every[0], own.name) for own in fields(FinetuneStage)}
    params = PretrainStage(
        **same | {"point_range": _around([own.point_range for own in every])},
        scenes=tuple(len(training.inputs) for training in trainings),
    )
    inputs = tuple(needed for training in trainings for needed in training.inputs)
    rigs = {own.stage.placement for own in inputs if hasattr(own.stage, "placement")}
    label = f"{params.detector} · {len(rigs)} rigs"
    return Task("pretrain", label, params, inputs, gpu=True, resumable=True)


def _around(ranges: Sequence[Crop]) -> Crop:
    bounds = np.array(ranges)
    low, high = bounds[:, :3].min(axis=0), bounds[:, 3:].max(axis=0)
    return (*low.tolist(), *high.tolist())

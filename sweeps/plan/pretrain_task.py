"""The training of a base checkpoint on the clouds of many rigs, in one scene or several."""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Crop
from sweeps.configuration.grid import Sweep
from sweeps.plan.trial import Plan, with_detector
from sweeps.stages.collect import CollectStage
from sweeps.stages.task import Task, tasks_of
from sweeps.stages.train import FinetuneStage, PretrainStage

_MIXED = ("placement", "lidar", "vehicle", "mounting_errors", "seed", "surrogate")
"""Axes that may have several values: those of the rig are mixed, the others do not matter."""


def training_of(sweep: Sweep, plan: Plan) -> Task[FinetuneStage]:
    """Return a training on the clouds of all placements, with the seed of the first point.

    Raises InputError: no detector, or several detectors, trainings, scenes, ROIs or lists of
    classes."""
    for axis in sweep.axes:
        # A value may be a list or a mapping.
        values = {repr(grid_point.axes[axis]) for grid_point in sweep.points}
        if axis.partition(".")[0] not in _MIXED and len(values) > 1:
            key, fix = f"grid.{axis}", f"choose with --set 'grid.{axis}=[…]'"
            every = ", ".join(sorted(values))
            raise InputError("a base is trained for one value", key=key, found=every, fix=fix)
    trainings = [trial.finetune for trial in with_detector(plan.trials) if trial.finetune]
    if not trainings:
        fix = "name the detector of the base"
        raise InputError("null or a command trains nothing", key="detector", fix=fix)
    inputs = {needed.key: needed for training in trainings for needed in training.inputs}
    stages = [training.stage for training in trainings]
    stage = replace(stages[0], point_range=_around([stage.point_range for stage in stages]))
    return Task(stage, stage.detector, tuple(inputs.values()))


def pretrain_task(trainings: Sequence[Task[FinetuneStage]]) -> Task[PretrainStage]:
    """Return one training on the clouds of several, with the network and settings that they share.

    `trainings`: of sweeps, or of the generalists of searches. Raises InputError: they differ in
    network or settings."""
    stages = [training.stage for training in trainings]
    for name in ("detector", "classes", "training", "typical", "seed"):
        values = {repr(getattr(stage, name)) for stage in stages}
        if len(values) > 1:
            listed, expected = " and ".join(sorted(values)), "one network for all configurations"
            raise InputError(key=name, expected=expected, found=listed)
    shared = {item.name: getattr(stages[0], item.name) for item in fields(FinetuneStage)}
    shared["point_range"] = _around([stage.point_range for stage in stages])
    scenes = tuple(len(training.inputs) for training in trainings)
    inputs = tuple(needed for training in trainings for needed in training.inputs)
    rigs = {task.stage.placement for task in tasks_of(CollectStage, inputs)}
    label = f"{stages[0].detector} · {len(rigs)} rigs"
    return Task(PretrainStage(**shared, scenes=scenes), label, inputs)


def _around(ranges: Sequence[Crop]) -> Crop:
    bounds = np.array(ranges)
    low, high = bounds[:, :3].min(axis=0), bounds[:, 3:].max(axis=0)
    return (*low.tolist(), *high.tolist())

"""The training of a base checkpoint on the clouds of all placements of a sweep."""

from collections.abc import Sequence
from dataclasses import replace

from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import Sweep
from sweeps.plan.trial import Plan, with_detector
from sweeps.tasks.results import Trained
from sweeps.tasks.task import Task

_MIXED = ("placement", "lidar", "seed", "surrogate")
"""Axes that may have several values: those of the rig are mixed, the others do not matter."""


def pretrain_task(sweep: Sweep, plan: Plan) -> Task[Trained]:
    """The training on the clouds of all placements of a sweep, with the seed of its first point.

    Raises:
        ConfigError: there is no detector, or the grid has several detectors, trainings, scenes,
            ROIs or lists of classes.
    """
    for axis in sweep.axes:
        # A value may be a list or a mapping.
        values = {repr(grid_point.axes[axis]) for grid_point in sweep.points}
        if axis.partition(".")[0] not in _MIXED and len(values) > 1:
            raise ConfigError(
                f"grid.{axis}: a base is trained for one value, found {', '.join(sorted(values))}; "
                f"choose with --set 'grid.{axis}=[…]'"
            )
    found = [trial.finetune for trial in with_detector(plan.trials)]
    trainings = [training for training in found if training is not None]
    if not trainings:
        raise ConfigError(
            "detector: null or a command trains nothing; name the detector of the base"
        )
    inputs = {needed.key: needed for training in trainings for needed in training.inputs}
    placements = {trial.grid_point.point.placement for trial in plan.trials}
    params = trainings[0].params
    return Task(
        "pretrain",
        f"{params.detector} · {len(placements)} placements",
        replace(params, point_range=_around([task.params.point_range for task in trainings])),
        tuple(inputs.values()),
        gpu=True,
        resumable=True,
    )


def _around(ranges: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """The smallest range that holds all."""
    low, high = zip(*((item[:3], item[3:]) for item in ranges), strict=True)
    return (*map(min, zip(*low, strict=True)), *map(max, zip(*high, strict=True)))

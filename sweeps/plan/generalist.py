"""Evaluation of placements by one detector that is trained on many rigs."""

from lidarplace import Placement
from lidarplace.base.errors import InputError, at
from lidarplace.mounting.random_rigs import has_other_lidar, random_rigs
from sweeps.configuration.point import Point
from sweeps.plan.clouds import TrialClouds
from sweeps.plan.planning import Planning
from sweeps.plan.specialist import evaluated_by, finetuned_from, training_stage
from sweeps.plan.trial import DetectorTrial, Trial
from sweeps.stages.task import Task
from sweeps.stages.train import FinetuneStage, PretrainStage
from training.typical_objects import TypicalObject


def plan_generalist(
    trial: Trial, clouds: TrialClouds, typical: tuple[TypicalObject, ...]
) -> DetectorTrial:
    """Evaluate by a detector that is trained on other rigs, once for all placements."""
    return evaluated_by(trial, clouds, _pretrain(clouds, training_stage(trial, clouds, typical)))


def plan_finetuned(
    trial: Trial, clouds: TrialClouds, typical: tuple[TypicalObject, ...]
) -> DetectorTrial:
    """Evaluate by that detector after it is trained further on the clouds of the placement."""
    training = training_stage(trial, clouds, typical)
    return finetuned_from(trial, clouds, training, [_pretrain(clouds, training)])


def _pretrain(clouds: TrialClouds, training: FinetuneStage) -> Task[PretrainStage]:
    """Add the training on many rigs: every frame under some of them, every rig in some frames."""
    planning, point = clouds.planning, clouds.grid_point.point
    if point.lidar.misaligned_heights:
        problem = "lidar.misaligned_heights crops the clouds of each rig differently"
        raise InputError(problem, key="evaluator", expected="specialist", found=point.evaluator)
    settings = point.generalist
    rigs = training_rigs(planning, point)
    every = -(-len(rigs) // min(settings.rigs_per_frame, len(rigs)))
    rig_clouds = [
        task
        for number, rig in enumerate(rigs)
        for task in clouds.collect("train", rig, rig.name, first=number % every, every=every)
    ]
    inputs = (*rig_clouds, *clouds.truths["train"])
    epochs = training.training.model_copy(update={"epochs": settings.epochs})
    stage = PretrainStage(**vars(training) | {"training": epochs}, scenes=(len(inputs),))
    label = f"generalist of {len(rigs)} rigs · {point.detector} · seed {point.seed}"
    return planning.add(stage, label, inputs)


def training_rigs(planning: Planning, point: Point) -> list[Placement]:
    """Return the rigs of a generalist: drawn with the seed of the training, or named."""
    rigs, sweep_rigs = point.generalist.rigs, planning.sweep.rigs
    with at(key="generalist.rigs"):
        if isinstance(rigs, int):
            around = tuple(sweep_rigs.of(point, name) for name in sorted(planning.placements))
            return planning.once(random_rigs, around, rigs, point.seed)
        evaluated = sorted(set(rigs) & set(planning.placements))
        if evaluated:
            raise InputError(f"{evaluated[0]} is evaluated, so it cannot be a training rig")
        named = [sweep_rigs.of(point, name) for name in rigs]
        if has_other_lidar(sweep_rigs.of(point), named):
            problem = f"none of {', '.join(rigs)} has a LiDAR of {point.placement}"
            raise InputError(problem, fix="name rigs with the evaluated LiDAR models")
        return named

"""Evaluation of a placement by a detector that is trained on its clouds."""

from collections.abc import Sequence

from sweeps.plan import named_files
from sweeps.plan.clouds import TrialClouds
from sweeps.plan.trial import DetectorTrial, Trial
from sweeps.stages.evaluate import EvaluateStage
from sweeps.stages.task import Task
from sweeps.stages.train import FinetuneStage, PretrainStage
from training.typical_objects import TypicalObject


def plan_specialist(
    trial: Trial, clouds: TrialClouds, typical: tuple[TypicalObject, ...]
) -> DetectorTrial:
    """Train on the clouds of the placement, from scratch or from a checkpoint, and evaluate."""
    return finetuned_from(trial, clouds, training_stage(trial, clouds, typical), ())


def finetuned_from(
    trial: Trial, clouds: TrialClouds, training: FinetuneStage, base: Sequence[Task[PretrainStage]]
) -> DetectorTrial:
    """Train on the clouds of the placement, starting from a generalist if there is one."""
    truths = clouds.truths
    inputs = (*base, *clouds.collect("train"), *truths["train"])
    finetune = clouds.planning.add(training, trial.label, inputs)
    return evaluated_by(trial, clouds, finetune)


def evaluated_by(trial: Trial, clouds: TrialClouds, weights: Task[FinetuneStage]) -> DetectorTrial:
    """Evaluate the placement by a detector that a task trains."""
    point, training = trial.grid_point.point, weights.stage
    truths, test = clouds.truths, clouds.collect("test")
    stage = EvaluateStage(
        training.detector,
        point.classes,
        point.training,
        clouds.crop,
        typical=training.typical,
        ious=tuple(point.own_ious().items()),
        metrics=point.metrics,
    )
    return DetectorTrial(
        **vars(trial),
        ground_truths=tuple(dict.fromkeys(truths["train"] + truths["test"])),
        collect_test=tuple(test),
        finetune=weights,
        evaluate=clouds.planning.add(stage, trial.label, (weights, *test, *truths["test"])),
    )


def training_stage(
    trial: Trial, clouds: TrialClouds, typical: tuple[TypicalObject, ...]
) -> FinetuneStage:
    """Return the training on the clouds of the placement, after a check of network and checkpoint.

    `typical`: objects of classes without anchors; those of a checkpoint come before them."""
    point, crop = trial.grid_point.point, clouds.crop
    detector, settings, once = point.detector, point.training, clouds.planning.once
    assert detector is not None
    checkpoint = None
    if settings.checkpoint is not None:
        sized = (name for name, sizes in point.class_settings.items() if sizes.size is not None)
        checkpoint, typical = once(
            named_files.checkpoint_of,
            settings.checkpoint,
            settings.new_heads,
            detector,
            point.classes,
            crop,
            typical,
            frozenset(sized),
        )
    once(named_files.check_network, detector, point.classes, crop, typical)
    return FinetuneStage(
        detector,
        point.classes,
        settings,
        crop,
        typical=typical,
        seed=point.seed,
        checkpoint=checkpoint,
    )

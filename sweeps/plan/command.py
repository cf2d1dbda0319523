"""Evaluation of placements by a command of the user."""

import re
import shlex

from lidarplace.base.errors import InputError
from lidarplace.files.secret_urls import secret_argument
from sweeps.configuration.evaluator import EvaluatorCommand
from sweeps.plan import named_files
from sweeps.plan.clouds import TrialClouds
from sweeps.plan.trial import DetectorTrial, Trial
from sweeps.stages.command import CommandStage
from sweeps.stages.measure import MeasureStage
from training.typical_objects import TypicalObject


def plan_command(
    trial: Trial, clouds: TrialClouds, typical: tuple[TypicalObject, ...]
) -> DetectorTrial:
    """Evaluate by the detections of a command, which needs no typical objects."""
    planning, point = clouds.planning, trial.grid_point.point
    command, common = point.evaluator, planning.sweep.common
    assert isinstance(command, EvaluatorCommand)
    if not command.folder.is_dir():
        raise InputError("no such folder", key="evaluator.folder", found=command.folder)
    if (name := secret_argument(shlex.split(command.command))) is not None:
        text = f"evaluator.command: {name} looks like a secret, which config.yaml and MLflow "
        planning.caution(f"{text}show; pass it as an environment variable.")
    file = re.sub(r"[^\w.=-]+", "-", trial.label)[:200]
    stage = CommandStage(
        command,
        planning.once(named_files.digests_of, command.depends_on),
        point.classes,
        point.placement if command.uses("rig") else None,
        point.seed if command.uses("seed") else None,
        log=common.output / common.name / "commands" / f"{file}.log",
    )
    truths, test = clouds.truths, clouds.collect("test")
    objects = tuple(dict.fromkeys(truths["train"] + truths["test"]))
    inputs = (*clouds.scenes, *clouds.collect("train"), *test, *objects)
    detect = planning.add(stage, trial.label, inputs)
    measure = MeasureStage(point.classes, tuple(point.own_ious().items()), point.metrics)
    return DetectorTrial(
        **vars(trial),
        ground_truths=objects,
        collect_test=tuple(test),
        finetune=None,
        evaluate=planning.add(measure, trial.label, (detect, *truths["test"])),
    )

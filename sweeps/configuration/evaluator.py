"""A command as the evaluator: `evaluator: {command: …}`."""

import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator
from pydantic.functional_validators import ModelWrapValidatorHandler, WrapValidator

from lidarplace.base.errors import InputError
from lidarplace.base.suggestions import did_you_mean
from lidarplace.configuration import settings
from lidarplace.configuration.settings import Count, CountFromOne, FileBeside, Seconds, Settings
from lidarplace.logs.plausibility import DetectionCheck
from lidarplace.scenes.layouts import LayoutName

PLACEHOLDERS = ("{clouds}", "{detections}", "{rig}", "{seed}", "{python}")
EVALUATORS = ("specialist", "generalist", "finetuned", "pretrained")


class EvaluatorCommand(Settings):
    """A program of the user that detects objects in the clouds of each rig."""

    # Fields that are not dumped do not decide its detections.

    command: settings.Text = Field(
        description="program and arguments, run without a shell; {clouds}: folder of the frames, "
        "{detections}: folder for its detections; {rig}, {seed}, {python}: set by the sweep"
    )
    format: LayoutName = Field(description="format of clouds and detections; parquet: plain files")
    name: settings.Name = Field(
        "command",
        exclude=True,
        pattern=r"^\w[\w.-]*$",
        description="name of the detector in tables",
    )
    folder: FileBeside = Field(
        Path(),
        exclude=True,
        validate_default=True,
        description="working directory, relative to the folder of the configuration",
    )
    depends_on: tuple[FileBeside, ...] = Field(
        (),
        exclude=True,
        description="files and folders, relative to the folder of the configuration: it runs again "
        "if their content changes",
    )
    cpus: CountFromOne = Field(1, exclude=True, description="number of CPUs that it uses")
    gpus: Count = Field(
        0, exclude=True, description="number of GPUs that it uses, if there are any"
    )
    time_limit: Seconds = Field(
        86_400.0, exclude=True, gt=0, description="seconds before it is killed"
    )
    accept: tuple[DetectionCheck, ...] = Field(
        (), exclude=True, description="checks of its detections to skip"
    )

    @field_validator("command")
    @classmethod
    def _possible(cls, command: str) -> str:
        if not shlex.split(command) or "\0" in command:
            raise InputError(expected="a program with its arguments")
        for name in re.findall(r"\{\w+\}", command):
            if name not in PLACEHOLDERS:
                problem = f"unknown placeholder {name}{did_you_mean(name, PLACEHOLDERS)}"
                raise InputError(problem, expected=", ".join(PLACEHOLDERS))
        for name in PLACEHOLDERS[:2]:
            if name not in command:
                raise InputError(f"{name} is missing, and nothing else names that folder")
        return command

    def uses(self, placeholder: str) -> bool:
        """Return whether the command has a placeholder."""
        return f"{{{placeholder}}}" in self.command


def _checked(evaluator: Any, _: ModelWrapValidatorHandler[Any], info: ValidationInfo) -> Any:
    # Not by the union, whose error would be of all its members.
    if isinstance(evaluator, (Mapping, EvaluatorCommand)):
        command = EvaluatorCommand.model_validate(evaluator, context=info.context)
        if command.name in EVALUATORS:
            problem, fix = (
                f"{command.name} is a built-in evaluator",
                "choose another name for the command",
            )
            raise InputError(problem, key="name", fix=fix)
        return command
    if evaluator not in EVALUATORS:
        hint = did_you_mean(evaluator, EVALUATORS) if isinstance(evaluator, str) else ""
        raise InputError(expected=f"{', '.join(EVALUATORS)}, or a mapping with command{hint}")
    return evaluator


Evaluator = Annotated[
    Literal["specialist", "generalist", "finetuned", "pretrained"] | EvaluatorCommand,
    WrapValidator(_checked),
]
"""What evaluates a placement."""

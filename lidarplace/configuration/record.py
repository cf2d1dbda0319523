"""Records: JSON files that are validated against a model, with errors of one line."""

from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BeforeValidator, Field

from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import validated
from lidarplace.files.json_file import read_json

T = TypeVar("T")


def _no_truth(value: object) -> object:
    if isinstance(value, bool):
        raise InputError(expected="a number")
    return value


NoTruth = BeforeValidator(_no_truth)
"""Validator of numbers that may be in quotes, as CARLA and protobuf write them; `true` is none."""
Number = Annotated[float, NoTruth, Field(allow_inf_nan=False)]  # finite


def read_record(path: Path, kind: type[T], description: str) -> T:
    """Read a JSON file as a dataclass or a pydantic model.

    `description` of the file is for messages. Raises ValueError: as `read_json`, or the content is
    something else."""
    return validated(kind, read_json(path), f"{path}: not a valid {description}")

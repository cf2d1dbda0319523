"""A placement as a command takes it: the paper's by name, or a YAML file of its own."""

from __future__ import annotations

from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from lidarplace.placement import PAPER_PLACEMENTS, Mount, Placement
from lidarplace.sensor import Lidar


class _Mount(BaseModel):
    model_config = ConfigDict(extra="forbid")

    x: FiniteFloat = 0.0
    y: FiniteFloat = 0.0
    z: FiniteFloat
    roll: FiniteFloat = 0.0
    pitch: FiniteFloat = 0.0
    yaw: FiniteFloat = 0.0


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    mounts: list[_Mount] = Field(min_length=1)


def named_placement(name: str, lidar: Lidar) -> Placement:
    """The paper's placement of this name, or the one in the file FILE.yaml, with `lidar`.

    Raises:
        OSError: the file cannot be read.
        ValueError: there is no placement of that name, or the file is wrong.
    """
    if name.endswith((".yaml", ".yml")):
        return read_placement(Path(name), lidar)
    if name not in PAPER_PLACEMENTS:
        raise ValueError(
            f"--placement {name}: allowed are {', '.join(PAPER_PLACEMENTS)} and a FILE.yaml"
        )
    return PAPER_PLACEMENTS[name].with_lidar(lidar)


def read_placement(path: Path, lidar: Lidar) -> Placement:
    """Read `mounts`, a list of poses in the ego frame: metres and radians, `z` is needed.

    The placement has the name of the file.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not such a list; the message names file, key and value.
    """
    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is not YAML: {' '.join(str(error).split())}") from None
    try:
        mounts = _File.model_validate(raw).mounts
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ValueError(
            f"{path}: {key + ': ' if key else ''}{first['msg']}, found {first['input']!r}"
        ) from None
    try:
        return Placement(path.stem, [Mount(**mount.model_dump()) for mount in mounts], lidar)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None

"""The rigs that this project reads everywhere: YAML files with `mounts`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from lidarplace.configuration.placement import read_placement_settings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.files.atomic import write_text
from lidarplace.rig_files.mounted import MountedLidar

DIGITS = 9
"""Decimals of metres and degrees: of what rounding leaves of 45 degrees there is no trace."""


def read_own(path: Path) -> list[MountedLidar]:
    """The LiDARs of a file of `mounts`; those without a name are numbered.

    Raises ValueError as `read_placement_settings` does.
    """
    settings = read_placement_settings(path)
    return [
        MountedLidar(each.name or f"lidar_{number}", mount, each.lidar)
        for number, (each, mount) in enumerate(
            zip(settings.mounts, settings.in_ego(settings.mounts), strict=True)
        )
    ]


def write_own(path: Path, lidars: Sequence[MountedLidar]) -> None:
    """Write LiDARs in the ego frame; angles in degrees."""
    mounts = [_mount(lidar) for lidar in lidars]
    text = yaml.safe_dump(
        {"mounts": mounts}, sort_keys=False, default_flow_style=None, width=1000, allow_unicode=True
    )
    write_text(path, text)


def _mount(lidar: MountedLidar) -> dict[str, Any]:
    mount = lidar.mount
    place = {axis: round(getattr(mount, axis), DIGITS) + 0.0 for axis in "xyz"}
    turned = {
        f"{name}_deg": degrees
        for name in ("roll", "pitch", "yaw")
        if (degrees := round(float(np.degrees(getattr(mount, name))), DIGITS))
    }
    model = {} if lidar.model is None else {"lidar": as_written(lidar.model)}
    return {"name": lidar.name, **place, **turned, **model}


def as_written(model: SensorSettings) -> Any:
    """As one would write it: the name alone where nothing was changed of the catalogue's."""
    if model.name is None:
        return model.model_dump(mode="json", exclude_defaults=True)
    known = SensorSettings(name=model.name).model_dump(mode="json")
    changed = {k: v for k, v in model.model_dump(mode="json").items() if v != known[k]}
    return {"name": model.name, **changed} if changed else model.name

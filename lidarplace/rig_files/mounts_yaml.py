"""Rigs that this project reads everywhere: YAML files with `mounts`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from lidarplace.configuration.further_sensors import (
    CameraSettings,
    RadarSettings,
    further_catalogue,
)
from lidarplace.configuration.placement import read_placement_settings
from lidarplace.configuration.pose import PoseSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.files.atomic import write_text
from lidarplace.rig_files.mounted import RigSensor, lidars_in

DIGITS = 9
"""Decimals of metres and degrees, which leave no trace of rounding."""


def read_mounts_yaml(path: Path) -> list[RigSensor]:
    """Read the sensors of a file of `mounts`, LiDARs first; those without a name are numbered.

    Raises ValueError as `read_placement_settings`."""
    settings = read_placement_settings(path)
    lidars = zip(settings.mounts, settings.in_ego(settings.mounts), strict=True)
    several: tuple[CameraSettings | RadarSettings, ...] = (*settings.cameras, *settings.radars)
    others = zip(several, settings.in_ego(several), strict=True)
    return [
        *(
            RigSensor(each.name or f"lidar_{number}", mount, each.lidar)
            for number, (each, mount) in enumerate(lidars, 1)
        ),
        *(
            RigSensor(each.name or f"{each.KIND}_{number}", mount, further=each)
            for number, (each, mount) in enumerate(others, 1)
        ),
    ]


def write_mounts_yaml(path: Path, lidars: Sequence[RigSensor]) -> None:
    """Write LiDARs, cameras and radars in the ego frame; angles in degrees."""
    content = {"mounts": [_mount(lidar) for lidar in lidars_in(lidars)]}
    for kind in ("camera", "radar"):
        if mounts := [_mount(sensor) for sensor in lidars if sensor.kind == kind]:
            content[f"{kind}s"] = mounts
    options: dict[str, Any] = {"sort_keys": False, "default_flow_style": None, "width": 1000}
    write_text(path, yaml.safe_dump(content, allow_unicode=True, **options))


def _mount(lidar: RigSensor) -> dict[str, Any]:
    mount = lidar.mount
    place = {axis: round(getattr(mount, axis), DIGITS) + 0.0 for axis in "xyz"}
    turned = {
        f"{name}_deg": degrees
        for name in ("roll", "pitch", "yaw")
        if (degrees := round(float(np.degrees(getattr(mount, name))), DIGITS))
    }
    model = {} if lidar.model is None else {"lidar": as_written(lidar.model)}
    if lidar.further is not None:
        written = lidar.further.model_dump(mode="json", include=lidar.further.model_fields_set)
        model = {k: v for k, v in written.items() if k not in PoseSettings.model_fields}
        if lidar.further.model is not None:
            listed = further_catalogue()[lidar.further.model]
            model = {k: v for k, v in model.items() if v != listed.get(k)}
    return {"name": lidar.name, **place, **turned, **model}


def as_written(model: SensorSettings) -> Any:
    """Return settings as one writes them: the name alone of an unchanged LiDAR of the catalogue."""
    if model.name is None:
        return model.model_dump(mode="json", exclude_defaults=True)
    listed = SensorSettings(name=model.name).model_dump(mode="json")
    changed = {k: v for k, v in model.model_dump(mode="json").items() if v != listed[k]}
    return {"name": model.name, **changed} if changed else model.name

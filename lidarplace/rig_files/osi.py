"""Rigs as ASAM OSI's `SensorViewConfiguration`, in protobuf's JSON.

https://opensimulationinterface.github.io/osi-antora-generator/asamosi/latest/gen describes the
messages. They say how a simulator shall show the world to a LiDAR, not which LiDAR it is: rays in
them may be any number, so models are not read.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict
from pydantic.alias_generators import to_camel

from lidarplace.configuration.record import NoTruth, Number, read_record
from lidarplace.files.atomic import write_text
from lidarplace.rig_files.mounted import MountedLidar, mount_at, named_like


class _Message(BaseModel):
    """Field names as in the messages, or as protobuf's JSON has them; what is 0 may be left out."""

    model_config = ConfigDict(alias_generator=to_camel, populate_by_name=True, extra="ignore")


class _Vector3d(_Message):
    x: Number = 0.0
    y: Number = 0.0
    z: Number = 0.0


class _Orientation3d(_Message):
    """Radians; yaw about z, then pitch about the new y, then roll about the new x."""

    roll: Number = 0.0
    pitch: Number = 0.0
    yaw: Number = 0.0


class _MountingPosition(_Message):
    position: _Vector3d = _Vector3d()
    orientation: _Orientation3d = _Orientation3d()


class _Identifier(_Message):
    value: Annotated[int, NoTruth] = 0


class _LidarSensorViewConfiguration(_Message):
    sensor_id: _Identifier = _Identifier()
    mounting_position: _MountingPosition


class _SensorViewConfiguration(_Message):
    lidar_sensor_view_configuration: list[_LidarSensorViewConfiguration]


def read_osi(path: Path, only: Sequence[str]) -> list[MountedLidar]:
    """The LiDARs of a configuration, called by their ids, `lidar_1`.

    Raises ValueError: the file is no such configuration.
    """
    view = read_record(path, _SensorViewConfiguration, "SensorViewConfiguration of ASAM OSI")
    lidars = []
    for each in view.lidar_sensor_view_configuration:
        at, turned = each.mounting_position.position, each.mounting_position.orientation
        name = f"lidar_{each.sensor_id.value}"
        angles = (turned.roll, turned.pitch, turned.yaw)
        mount = mount_at((at.x, at.y, at.z), angles, f"{path}: {name}")
        lidars.append(MountedLidar(name, mount))
    names = named_like([lidar.name for lidar in lidars], only, str(path))
    return [lidar for lidar in lidars if lidar.name in names]


def write_osi(path: Path, lidars: Sequence[MountedLidar]) -> None:
    """Write a configuration; ids count from 1.

    Rays are given for LiDARs that have a model, and their numbers for those without a pattern.
    OSI's fields of view are even about the sensor's axis: the smallest that holds all beams.
    """
    views = [
        {
            "sensorId": {"value": str(number)},
            "mountingPosition": {
                "position": {axis: getattr(lidar.mount, axis) for axis in "xyz"},
                "orientation": {
                    axis: getattr(lidar.mount, axis) for axis in ("roll", "pitch", "yaw")
                },
            },
            **_rays(lidar),
        }
        for number, lidar in enumerate(lidars, 1)
    ]
    write_text(path, json.dumps({"lidarSensorViewConfiguration": views}, indent=1))


def _rays(mounted: MountedLidar) -> dict[str, Any]:
    if mounted.model is None:
        return {}
    lidar = mounted.model.lidar()
    view = {
        "fieldOfViewHorizontal": 2 * max(abs(end) for end in lidar.azimuth),
        "fieldOfViewVertical": 2 * max(abs(elevation) for elevation in lidar.elevations),
    }
    if lidar.pattern is not None:
        return view
    return view | {"numberOfRaysHorizontal": lidar.fired_steps, "numberOfRaysVertical": lidar.beams}

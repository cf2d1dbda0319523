"""Rigs as ASAM OSI's `SensorViewConfiguration`, in protobuf's JSON.

See https://opensimulationinterface.github.io/osi-antora-generator/asamosi/latest/gen. It says how a
simulator shall show the world to a LiDAR, not which LiDAR it is: models are not read."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict
from pydantic.alias_generators import to_camel

from lidarplace.base.errors import at
from lidarplace.configuration.further_sensors import CameraSettings, RadarSettings
from lidarplace.configuration.record import NoTruth, Number, read_record
from lidarplace.configuration.settings import validated
from lidarplace.files.atomic import write_text
from lidarplace.rig_files.mounted import Place, RigSensor, named_like
from lidarplace.rigs.further_sensors import Camera
from lidarplace.rigs.placement import Mount


class _Message(BaseModel):
    """A message: fields by their names or as in protobuf's JSON; what is 0 may be left out."""

    model_config = ConfigDict(alias_generator=to_camel, populate_by_name=True, extra="ignore")


class _MountingPosition(_Message):
    """A pose in metres and radians: yaw about z, pitch about the new y, roll about the new x."""

    position: Place = Place()
    orientation: Place = Place()


class _Identifier(_Message):
    value: Annotated[int, NoTruth] = 0


class _OneSensor(_Message):
    """Fields of LiDARs, cameras and radars; angles are of cameras and radars, radians."""

    sensor_id: _Identifier = _Identifier()
    mounting_position: _MountingPosition
    field_of_view_horizontal: Number = 0.0
    field_of_view_vertical: Number = 0.0
    number_of_pixels_horizontal: Annotated[int, NoTruth] = 0
    number_of_pixels_vertical: Annotated[int, NoTruth] = 0


class _SensorViewConfiguration(_Message):
    lidar_sensor_view_configuration: list[_OneSensor] = []
    camera_sensor_view_configuration: list[_OneSensor] = []
    radar_sensor_view_configuration: list[_OneSensor] = []


def read_osi(path: Path, only: Sequence[str]) -> list[RigSensor]:
    """Read the sensors of a configuration, called by kind and id, `lidar_1`.

    Cameras have the angles and pixels that a simulator shall give them; radars their angles alone,
    and no range. Raises ValueError: it is not such a configuration."""
    view = read_record(path, _SensorViewConfiguration, "SensorViewConfiguration of ASAM OSI")
    lidars = []
    for kind in ("lidar", "camera", "radar"):
        for each in getattr(view, f"{kind}_sensor_view_configuration"):
            place, turned = each.mounting_position.position, each.mounting_position.orientation
            name = f"{kind}_{each.sensor_id.value}"
            with at(f"{path}: {name}"):
                mount = Mount(place.x, place.y, place.z, turned.roll, turned.pitch, turned.yaw)
                further = None if kind == "lidar" else _further(kind, each)
            lidars.append(RigSensor(name, mount, further=further))
    with at(path):
        names = named_like([lidar.name for lidar in lidars], only)
    return [lidar for lidar in lidars if lidar.name in names]


def _further(kind: str, sensor: _OneSensor) -> CameraSettings | RadarSettings:
    view = (sensor.field_of_view_horizontal, sensor.field_of_view_vertical)
    across, up = (round(math.degrees(angle), 9) for angle in view)
    pixels = (sensor.number_of_pixels_horizontal, sensor.number_of_pixels_vertical)
    if kind == "camera":
        values: dict[str, Any] = {"fov_deg": (across, up)} if across and up else {}
        values |= {"pixels": pixels} if all(pixels) else {}
    else:
        values = {"azimuth_deg": (-across / 2, across / 2)} if across else {}
        values |= {"elevation_deg": (-up / 2, up / 2)} if up else {}
    model: type[CameraSettings | RadarSettings]
    model = CameraSettings if kind == "camera" else RadarSettings
    return validated(model, {"z": 0.0} | values, "")


def write_osi(path: Path, lidars: Sequence[RigSensor]) -> None:
    """Write a configuration; ids count from 1, of each kind.

    Rays are given for LiDARs that have a model, and their numbers for those without a pattern.
    OSI's fields of view are even about the sensor's axis: the smallest that holds all beams."""
    content: dict[str, list[Any]] = {"lidarSensorViewConfiguration": []}
    for each in lidars:
        views = content.setdefault(f"{each.kind}SensorViewConfiguration", [])
        numbers = list(asdict(each.mount).items())
        place = {"position": dict(numbers[:3]), "orientation": dict(numbers[3:])}
        sensor = {"sensorId": {"value": str(len(views) + 1)}, "mountingPosition": place}
        views.append(sensor | _rays(each))
    write_text(path, json.dumps(content, indent=1))


def _rays(mounted: RigSensor) -> dict[str, Any]:
    if mounted.further is not None and (built := mounted.further.built()) is not None:
        if isinstance(built, Camera):
            angles = [
                2 * math.atan(max(at, side - at) / focal)
                for side, at, focal in zip(built.pixels, built.centre, built.focal, strict=True)
            ]
            pixels = zip(("Horizontal", "Vertical"), built.pixels, strict=True)
            view: dict[str, Any] = {f"numberOfPixels{side}": number for side, number in pixels}
        else:
            start, width = built.azimuth
            angles = [2 * max(abs(start), abs(start + width)), 2 * max(map(abs, built.elevation))]
            view = {}
        across, up = angles
        return {"fieldOfViewHorizontal": across, "fieldOfViewVertical": up} | view
    if mounted.model is None:
        return {}
    lidar = mounted.model.lidar()
    view = {
        "fieldOfViewHorizontal": 2 * max(map(abs, lidar.azimuth)),
        "fieldOfViewVertical": 2 * max(map(abs, lidar.elevations)),
    }
    if lidar.pattern is not None:
        return view
    return view | {"numberOfRaysHorizontal": lidar.fired_steps, "numberOfRaysVertical": lidar.beams}

"""Rigs as `objects.json` of CARLA's ROS bridge; poses are right-handed, in degrees.

See https://carla.readthedocs.io/projects/ros-bridge/en/latest/carla_spawn_objects."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import AliasChoices, BaseModel, ConfigDict, Field

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.record import NoTruth, Number, read_record
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import validated
from lidarplace.files.atomic import write_text
from lidarplace.rig_files.mounted import Place, RigSensor, lidars_in, named_like
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount
from lidarplace.scenes.routes import STEP_S

BLUEPRINT = "sensor.lidar.ray_cast"
UNEVEN = 1e-6
"""Radians by which a beam may miss its place in an even fan; CARLA computes in float32."""


class Fan(NamedTuple):
    """Beams at even distances, which one CARLA sensor can have; radians."""

    lower: float
    upper: float
    beams: int


def even_fans(elevations: Sequence[float]) -> list[Fan]:
    """Return the beam table as few fans as a greedy search finds, from the lowest beam up.

    CARLA spreads the channels of a sensor evenly between two elevations, so an even table is one
    fan; any other one is made of several sensors in one place."""
    table = np.sort(np.asarray(elevations, np.float64))
    fans, first = [], 0
    for end in range(1, len(table) + 1):
        run = table[first : end + 1]
        if end < len(table) and np.abs(run - np.linspace(run[0], run[-1], len(run))).max() < UNEVEN:
            continue
        fans.append(Fan(float(table[first]), float(table[end - 1]), end - first))
        first = end
    return fans


def attributes(lidar: Lidar, fan: Fan, seed: int) -> dict[str, str]:
    """Return attributes of the sensor that fires `fan`, one full turn a step.

    Without the losses that CARLA has by default."""
    values: dict[str, int | float] = {
        "channels": fan.beams,
        "lower_fov": math.degrees(fan.lower),
        "upper_fov": math.degrees(fan.upper),
        "range": lidar.reach,
        "points_per_second": round(fan.beams * lidar.azimuth_steps / STEP_S),
        "rotation_frequency": 1 / STEP_S,
        "dropoff_general_rate": lidar.drop_off,
        "dropoff_zero_intensity": 0.0,
        "noise_stddev": lidar.range_noise,
        "noise_seed": seed % 2**31,
    }
    return {n: str(v) if isinstance(v, int) else f"{v:.9g}" for n, v in values.items()}


def check_possible(lidar: Lidar, where: str) -> None:
    """Raise ValueError for what no LiDAR of CARLA's has."""
    for key, value, fix in (
        ("pattern of rays", lidar.pattern, "beams of CARLA's LiDARs turn"),
        ("correction", lidar.correction, "CARLA's LiDARs have none; leave it out"),
        ("offsets_m", lidar.offsets, "CARLA's LiDARs have none; set it to null"),
        ("rate_hz", lidar.timing, "CARLA's LiDARs have their own; leave it out"),
        ("azimuth_offsets_deg", lidar.azimuth_offsets, "CARLA's LiDARs have none; set it to null"),
    ):
        if value is not None:
            raise InputError(fix, place=where, key=key)


_Positive = Annotated[Number, Field(gt=0)]


class _Object(BaseModel):
    """An object to spawn; defaults of a LiDAR are CARLA's own.

    https://carla.readthedocs.io/en/latest/ref_sensors has them."""

    model_config = ConfigDict(extra="ignore")

    type: str
    id: str
    spawn_point: Place = Place()  # metres and degrees
    on_it: list[_Object] = Field([], validation_alias=AliasChoices("objects", "sensors"))
    channels: Annotated[int, NoTruth, Field(ge=1)] = 32
    range: _Positive = 10.0
    points_per_second: _Positive = 56_000.0
    rotation_frequency: _Positive = 10.0
    upper_fov: Number = 10.0
    lower_fov: Number = -30.0
    horizontal_fov: _Positive = 360.0
    noise_stddev: Number = 0.0
    dropoff_general_rate: Number = 0.45


class _Objects(BaseModel):
    """Content of the file."""

    objects: list[_Object]


def read_carla(path: Path, only: Sequence[str]) -> list[RigSensor]:
    """Read the ray-cast LiDARs on the one vehicle that has some.

    Sensors in one place that follow each other are one LiDAR: CARLA's have even beams, so a LiDAR
    of uneven beams is written as several. How CARLA weakens intensity is left out. Raises
    ValueError: the file is none of this kind, LiDARs are on several vehicles, or one is
    impossible."""
    objects = read_record(path, _Objects, "list of objects of CARLA's ROS bridge").objects
    carrying = [each for each in objects if any(o.type == BLUEPRINT for o in each.on_it)]
    with at(path):
        if len(carrying) > 1:
            vehicles, fix = ", ".join(each.id for each in carrying), "leave one in the file"
            raise InputError("several vehicles have LiDARs", found=vehicles, fix=fix)
        sensors = [o for each in carrying for o in each.on_it if o.type == BLUEPRINT]
        names = named_like([sensor.id for sensor in sensors], only)
        chosen = [sensor for sensor in sensors if sensor.id in names]
        return [_lidar(list(parts)) for _, parts in groupby(chosen, key=lambda o: o.spawn_point)]


def _lidar(parts: Sequence[_Object]) -> RigSensor:
    first, place = parts[0], parts[0].spawn_point
    steps = [
        o.points_per_second / (o.channels * o.rotation_frequency) * 360 / o.horizontal_fov
        for o in parts
    ]
    for other, count in zip(parts, steps, strict=True):
        shared = (round(count), other.range, other.horizontal_fov)
        if shared != (round(steps[0]), first.range, first.horizontal_fov):
            wrong = (
                f"{other.id} at the same place differs in azimuth steps, range or horizontal_fov"
            )
            raise InputError(wrong, place=first.id)
    elevations = [
        o.lower_fov + i * (o.upper_fov - o.lower_fov) / max(o.channels - 1, 1)
        for o in parts
        for i in range(o.channels)
    ]
    half = first.horizontal_fov / 2
    values = {
        "elevations_deg": tuple(elevations),
        "azimuth_steps": round(steps[0]),
        "range": first.range,
        "range_noise": first.noise_stddev,
        "drop_off": first.dropoff_general_rate,
        "azimuth_deg": (-half, half),
    }
    model = validated(SensorSettings, values, f"{first.id}: no LiDAR of ours")
    angles = (math.radians(angle) for angle in (place.roll, place.pitch, place.yaw))
    with at(first.id):
        return RigSensor(first.id, Mount(place.x, place.y, place.z, *angles), model)


def write_carla(path: Path, lidars: Sequence[RigSensor]) -> None:
    """Write one vehicle with all LiDARs on it, at the simulation's 20 turns a second.

    Raises ValueError: a LiDAR has no model, a pattern or a correction, or its field of view is not
    even about its x axis."""
    sensors = []
    for each in lidars_in(lidars):
        if each.model is None:
            fix = "name one of the catalogue with --lidar"
            raise InputError("no LiDAR model", place=each.name, fix=fix)
        lidar = each.model.lidar()
        check_possible(lidar, each.name)
        low, high = lidar.azimuth
        if abs(low + high) > 1e-9:
            view_deg = f"[{math.degrees(low):g}, {math.degrees(high):g}]"
            even = "a field of view symmetric to the x axis, as CARLA's LiDARs have"
            raise InputError(place=each.name, key="azimuth_deg", expected=even, found=view_deg)
        place = asdict(each.mount)
        for angle in ("roll", "pitch", "yaw"):
            place[angle] = round(math.degrees(place[angle]), 9)
        for number, fan in enumerate(even_fans(lidar.elevations)):
            name = each.name if number == 0 else f"{each.name}_beams_{number}"
            sensor = {"type": BLUEPRINT, "id": name, "spawn_point": place}
            view = {  # CARLA spreads all points over the field of view
                "horizontal_fov": f"{math.degrees(high - low):.9g}",
                "points_per_second": str(round(fan.beams * lidar.fired_steps / STEP_S)),
            }
            sensors.append(sensor | attributes(lidar, fan, number) | view)
    vehicle = {"type": "vehicle.*", "id": "ego_vehicle", "objects": sensors}
    write_text(path, json.dumps({"objects": [vehicle]}, indent=1))

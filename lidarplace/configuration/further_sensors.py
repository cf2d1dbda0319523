"""Cameras and radars in a configuration: of the catalogue, or one's own; degrees and metres."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, ClassVar, Self

import yaml
from pydantic import Field, field_validator, model_validator

from lidarplace.base.class_names import check_among
from lidarplace.base.errors import InputError
from lidarplace.base.suggestions import did_you_mean
from lidarplace.configuration.intrinsic import check_intrinsic
from lidarplace.configuration.pose import PoseSettings
from lidarplace.configuration.settings import (
    Amount,
    CountFromOne,
    Degrees,
    Distance,
    Elevation,
    Name,
    Number,
    Price,
    Text,
    Turn,
)
from lidarplace.logs.boxes import CLASSES
from lidarplace.rigs.further_sensors import Camera, Kind, MountedSensor, Radar
from lidarplace.rigs.placement import Mount

Ranges = dict[str, Annotated[Distance, Field(gt=0)]]
Row = tuple[Number, Number, Number]


@cache
def further_catalogue() -> Mapping[str, Mapping[str, Any]]:
    """Load cameras and radars that can be bought, by name: keys of settings, and sources."""
    file = files("lidarplace.rigs.catalogue").joinpath("cameras_and_radars.yaml")
    sensors: dict[str, dict[str, Any]] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return sensors


class FurtherSensorSettings(PoseSettings):
    """A camera or a radar on its mount."""

    KIND: ClassVar[Kind]
    NEEDED: ClassVar[str]

    model: Name | None = Field(None, description="name in the catalogue; other keys override it")
    range: Distance | None = Field(
        None, gt=0, description="largest distance at which it sees any object, metres"
    )
    ranges: Ranges = Field(default={}, description="the same by class of the object, metres")
    price: Price | None = Field(None, description="in any currency")
    power: Amount | None = Field(None, description="watts")
    source: Text | None = Field(None, description="source of its numbers")

    @model_validator(mode="before")
    @classmethod
    def _fill_from_catalogue(cls, data: Any) -> Any:
        name = data.get("model") if isinstance(data, dict) else None
        if not isinstance(name, str):
            return data
        models = {n: keys for n, keys in further_catalogue().items() if keys["kind"] == cls.KIND}
        if name not in models:
            wrong = f"no {cls.KIND} is called {name!r}{did_you_mean(name, models)}"
            raise InputError(wrong, key="model", expected=", ".join(models))
        return {key: v for key, v in models[name].items() if key in cls.model_fields} | data

    @field_validator("ranges")
    @classmethod
    def _of_known_classes(cls, ranges: dict[str, float]) -> dict[str, float]:
        check_among(ranges, CLASSES)
        return ranges

    @property
    def by_class(self) -> tuple[tuple[str, float], ...]:
        """The ranges, that of any other class by the name ""."""
        every = {} if self.range is None else {"": self.range}
        return tuple((every | self.ranges).items())


class CameraSettings(FurtherSensorSettings):
    """A camera that looks along the x axis of its mount."""

    KIND = "camera"
    NEEDED = "pixels and fov_deg or intrinsic"

    pixels: tuple[CountFromOne, CountFromOne] | None = Field(
        None, description="width and height of its images"
    )
    fov_deg: tuple[Degrees, Degrees] | None = Field(
        None, description="horizontal and vertical field of view, below 180"
    )
    intrinsic: tuple[Row, Row, Row] | None = Field(
        None,
        description="in place of fov_deg, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, as "
        "calibration finds it",
    )

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.fov_deg is not None and self.intrinsic is not None and self.model is None:
            raise InputError("intrinsic is set, too", key="fov_deg", fix="set only one")
        if self.fov_deg is not None and not all(0 < angle < 180 for angle in self.fov_deg):
            raise InputError(key="fov_deg", expected="angles within (0, 180)", found=self.fov_deg)
        if self.intrinsic is not None:
            check_intrinsic(self.intrinsic, self.pixels)
        return self

    def built(self) -> Camera | None:
        """Build the camera; None where pixels or angles are not known."""
        if self.pixels is None or (self.fov_deg is None and self.intrinsic is None):
            return None
        width, height = self.pixels
        if self.intrinsic is not None:
            (fx, _, cx), (_, fy, cy), _ = self.intrinsic
            return Camera(self.pixels, (fx, fy), (cx, cy), self.by_class)
        assert self.fov_deg is not None
        across, up = (2 * math.tan(math.radians(0.5 * angle)) for angle in self.fov_deg)
        centre = (0.5 * width, 0.5 * height)
        return Camera(self.pixels, (width / across, height / up), centre, self.by_class)


class RadarSettings(FurtherSensorSettings):
    """A radar on its mount."""

    KIND = "radar"
    NEEDED = "azimuth_deg, elevation_deg and range"

    azimuth_deg: Turn | None = Field(None, description="[from, to], to the left")
    elevation_deg: tuple[Elevation, Elevation] | None = Field(None, description="[lowest, highest]")
    cell: tuple[Distance, Degrees] | None = Field(
        None, description="resolution: metres of range, and degrees of azimuth"
    )

    @model_validator(mode="after")
    def _possible(self) -> Self:
        ends, expected = self.elevation_deg, "[min, max] with min < max"
        if ends is not None and not ends[0] < ends[1]:
            raise InputError(key="elevation_deg", expected=expected, found=ends)
        return self

    def built(self) -> Radar | None:
        """Build the radar; None where its angles or its range are not known."""
        if self.azimuth_deg is None or self.elevation_deg is None or self.range is None:
            return None
        start, end = map(math.radians, self.azimuth_deg)
        low, high = map(math.radians, self.elevation_deg)
        return Radar((start, end - start), (low, high), self.by_class)


def further_sensors(
    cameras: Sequence[CameraSettings], radars: Sequence[RadarSettings], mounts: Sequence[Mount]
) -> tuple[MountedSensor, ...]:
    """Build cameras, then radars, on their mounts; those without a name are numbered from 1.

    Raises ValueError: it is not known what one sees, or two have one name."""
    sensors: tuple[CameraSettings | RadarSettings, ...] = (*cameras, *radars)
    keys = [("cameras", n) for n in range(len(cameras))] + [
        ("radars", n) for n in range(len(radars))
    ]
    mounted: dict[str, MountedSensor] = {}
    for sensor, mount, (key, n) in zip(sensors, mounts, keys, strict=True):
        model, name = sensor.built(), sensor.name or f"{sensor.KIND} {n + 1}"
        if model is None:
            expected = f"model, or {sensor.NEEDED}"
            raise InputError("unknown field of view", key=f"{key}[{n}]", expected=expected)
        if name in mounted:
            raise InputError(f"duplicate name {name!r}", key=f"{key}[{n}].name", fix="rename one")
        mounted[name] = MountedSensor(name, mount, model)
    return tuple(mounted.values())

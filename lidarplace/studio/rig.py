"""A rig that a person edits: LiDARs in the numbers and units of its file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from lidarplace.base.errors import at
from lidarplace.configuration.further_sensors import CameraSettings, RadarSettings
from lidarplace.configuration.placement import MountSettings, PlacementSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import fault
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.pose import from_carla

POSE = ("x", "y", "z", "roll", "pitch", "yaw")
ANGLES = POSE[3:]
ASIDE_M = 0.3
"""Distance to the left of a LiDAR at which its duplicate is, metres."""

_TURNED = {"y", "pitch", "yaw"}  # what CARLA's convention has with the other sign
_ACROSS = {"y", "roll", "yaw"}  # what a mirror image has with the other sign


@dataclass(frozen=True)
class LidarEntry:
    """A LiDAR of a rig; paths are relative to `folder`. Raises ValueError that names a wrong key.

    `written` are keys of `MountSettings` as the file has them, so that a number which nobody
    changes stays what it is, to the last digit and in its unit."""

    written: Mapping[str, Any]
    enabled: bool = True
    folder: Path | None = field(default=None, compare=False, repr=False)
    settings: MountSettings = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        try:
            context = {"folder": self.folder}
            settings = MountSettings.model_validate(dict(self.written), context=context)
        except ValidationError as error:
            raise fault(error) from None
        object.__setattr__(self, "settings", settings)

    @property
    def model(self) -> str | None:
        """Name in the catalogue; None if the file describes it, or leaves it to the default."""
        return None if self.settings.lidar is None else self.settings.lidar.name


@dataclass(frozen=True)
class Rig:
    """LiDARs on a vehicle as a file has them, disabled ones, too, or none at all.

    `carla` says whether the file has poses in CARLA's convention; `further` are its keys of cameras
    and radars."""

    name: str
    lidars: tuple[LidarEntry, ...] = ()
    carla: bool = False
    further: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of_written(cls, name: str, written: Mapping[str, Any], folder: Path | None = None) -> Rig:
        """Read a mapping with `mounts` and `convention`. Raises as `LidarEntry` does."""
        lidars = []
        for number, mount in enumerate(written.get("mounts", ())):
            with at(f"mounts[{number}]"):
                lidars.append(LidarEntry(mount, folder=folder))
        further = {key: written[key] for key in ("cameras", "radars") if key in written}
        return cls(name, tuple(lidars), written.get("convention") == "carla", further)

    @property
    def written(self) -> dict[str, Any]:
        """Keys of `PlacementSettings`; also of LiDARs that are disabled: they are mounted."""
        convention = {"convention": "carla"} if self.carla else {}
        mounts = {"mounts": [dict(lidar.written) for lidar in self.lidars]}
        return convention | mounts | dict(self.further)

    @cached_property
    def _as_placement(self) -> PlacementSettings:
        return PlacementSettings.model_validate(self.written | {"mounts": [{"z": 0.0}]})

    @cached_property
    def sensors(self) -> tuple[MountedSensor, ...]:
        """Cameras and radars, in the ego frame; they always work."""
        return self._as_placement.further()

    @property
    def settings_of_sensors(self) -> tuple[CameraSettings | RadarSettings, ...]:
        """Settings of cameras and radars, in the same order."""
        return (*self._as_placement.cameras, *self._as_placement.radars)

    @cached_property
    def mounts(self) -> tuple[Mount, ...]:
        """Mounts of all LiDARs, in the ego frame."""
        poses = (lidar.settings.pose for lidar in self.lidars)
        return tuple(Mount(*(from_carla(*pose) if self.carla else pose)) for pose in poses)

    @property
    def working(self) -> list[int]:
        """Numbers of the LiDARs that work."""
        return [number for number, lidar in enumerate(self.lidars) if lidar.enabled]

    def models(self, default: SensorSettings) -> tuple[Lidar, ...]:
        """Return the models of all LiDARs; `default` where none is named."""
        models = (mounted.settings.lidar or default for mounted in self.lidars)
        return tuple(model.lidar(default.losses) for model in models)

    def placement(self, default: SensorSettings) -> Placement | None:
        """Return the LiDARs that work, None without any; `default` where no model is named.

        Raises ValueError: two of them are in one place."""
        models, mounts = self.models(default), [self.mounts[number] for number in self.working]
        working = [models[number] for number in self.working]
        return Placement(self.name, mounts, lidar=working) if working else None

    def pose(self, number: int) -> dict[str, float]:
        """Return the pose of a LiDAR by the names of `POSE`: ego frame, metres and degrees."""
        settings = self.lidars[number].settings
        pose = {axis: float(getattr(settings, axis)) for axis in POSE[:3]}
        for angle in ANGLES:
            degrees = getattr(settings, f"{angle}_deg")
            pose[angle] = math.degrees(getattr(settings, angle)) if degrees is None else degrees
        return {name: self._turned(name, value) for name, value in pose.items()}

    def _turned(self, name: str, value: float) -> float:
        """Convert a coordinate from the ego frame to the file's convention, or back."""
        return 0 - value if self.carla and name in _TURNED else value

    def _with(self, number: int, lidar: LidarEntry) -> Rig:
        return replace(self, lidars=(*self.lidars[:number], lidar, *self.lidars[number + 1 :]))


def pose_of(mount: Mount) -> dict[str, float]:
    """Return a pose by the names of `POSE`, metres and degrees, without rounding of radians."""
    turn = {name: round(math.degrees(getattr(mount, name)), 6) for name in ANGLES}
    return {"x": mount.x, "y": mount.y, "z": mount.z} | turn


def posed(rig: Rig, number: int, **pose: float) -> Rig:
    """Return the rig with a LiDAR at other coordinates of `POSE`: ego frame, metres and degrees.

    An angle that the file has in radians stays one of radians, all others are written in degrees.
    Raises ValueError: a number is beyond its limits."""
    before, lidar = rig.pose(number), rig.lidars[number]
    written = dict(lidar.written)
    for name, value in pose.items():
        if value == before[name]:
            continue
        value = rig._turned(name, value)
        if name in ANGLES and not written.get(name):  # a zero has no unit
            written.pop(name, None)
            written[f"{name}_deg"] = value
        else:
            written[name] = math.radians(value) if name in ANGLES else value
    return rig._with(number, replace(lidar, written=written))


def added(rig: Rig, model: str | None = None, **pose: float) -> Rig:
    """Return the rig with one more LiDAR, of the catalogue's model or of the default one."""
    named = {} if model is None else {"lidar": model}
    mounted = LidarEntry({"x": 0.0, "y": 0.0, "z": 0.0} | named)
    return posed(replace(rig, lidars=(*rig.lidars, mounted)), len(rig.lidars), **pose)


def removed(rig: Rig, number: int) -> Rig:
    """Return the rig without a LiDAR."""
    return replace(rig, lidars=(*rig.lidars[:number], *rig.lidars[number + 1 :]))


def duplicated(rig: Rig, number: int) -> Rig:
    """Return the rig with a LiDAR once more, `ASIDE_M` to its left."""
    wider = replace(rig, lidars=(*rig.lidars, rig.lidars[number]))
    return posed(wider, len(rig.lidars), y=round(rig.pose(number)["y"] + ASIDE_M, 6))


def mirrored(rig: Rig, number: int) -> Rig:
    """Return the rig with a LiDAR's mirror image, too. Raises ValueError: it is at y = 0."""
    pose = rig.pose(number)
    if pose["y"] == 0:
        raise ValueError(f"LiDAR {number + 1} is at y = 0, where its mirror image would be, too")
    wider = replace(rig, lidars=(*rig.lidars, rig.lidars[number]))
    return posed(wider, len(rig.lidars), **{name: 0 - pose[name] for name in _ACROSS})


def enabled(rig: Rig, number: int, works: bool) -> Rig:
    """Return the rig with a LiDAR that works or does not."""
    return rig._with(number, replace(rig.lidars[number], enabled=works))


def working(rig: Rig) -> Rig:
    """Return the rig without the LiDARs that are disabled."""
    return replace(rig, lidars=tuple(rig.lidars[number] for number in rig.working))


def of_model(rig: Rig, number: int, model: str | None) -> Rig:
    """Return the rig with another model of the catalogue for a LiDAR; None: the default.

    Raises ValueError: it is unknown."""
    lidar = rig.lidars[number]
    written = {key: value for key, value in lidar.written.items() if key != "lidar"}
    named = {} if model is None else {"lidar": model}
    return rig._with(number, replace(lidar, written=written | named))

"""The file of a studio: rigs, the vehicle or the site that carries them, and what it allows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.answer import as_rigs, is_answer
from lidarplace.configuration.mounting import (
    KeepOuts,
    LimitSettings,
    carrier_of,
    keep_out_boxes,
    mountable,
)
from lidarplace.configuration.placement import MOST_MOUNTS, MountSettings, PlacementSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import Name, Price, fault, short_for
from lidarplace.configuration.vehicle import OwnVehicle, VehicleSettings, vehicle_of
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.configuration.zones import CountRange, ZoneSettings
from lidarplace.files.atomic import write_text
from lidarplace.mounting.counts import CountBound
from lidarplace.mounting.limits import Limits
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.mounting.zone import Zone
from lidarplace.recall.detection_curve import default_curves
from lidarplace.requirements.layout import RequirementLayout, lay_out
from lidarplace.requirements.settings import Requirements
from lidarplace.scenes.kerbs import with_strips
from lidarplace.scenes.kinds import Scene, obstacles_around, poles_at
from lidarplace.scenes.site import Obstacles, Site, SiteOrVehicle
from lidarplace.studio.log_frames import simulated_scene
from lidarplace.studio.rig import Rig


class RigSettings(PlacementSettings):
    """A placement by coordinates; it may be without LiDARs yet."""

    mounts: tuple[MountSettings, ...] = Field(
        default=(), max_length=MOST_MOUNTS, description="a LiDAR each"
    )


class RigsSettings(SiteOrVehicle):
    """The file as a whole. What a search has under `search` has the same keys there."""

    lidar: Annotated[SensorSettings, short_for("name")] = Field(
        SensorSettings(), description="the LiDARs, unless a mount has its own"
    )
    vehicle: OwnVehicle = Field(None, description="the body of the vehicle; a car by default")
    site: Site | None = Field(
        None, description="LiDARs on poles beside the road instead of a vehicle, as in a sweep"
    )
    scene: Scene | None = Field(
        None,
        description="traffic at the site, as in a sweep; half a minute of simulated traffic by "
        "default",
    )
    placements: dict[Name, RigSettings] = Field(
        default={"mine": RigSettings()}, min_length=1, description="rigs by name"
    )
    zones: dict[Name, ZoneSettings] = Field(
        {}, description="zones by name: where a LiDAR may be mounted; anywhere without zones"
    )
    lidars: CountRange | None = Field(None, description="number of LiDARs, or [min, max]")
    counts: dict[Name, CountRange] = Field(
        default={}, description="number of LiDARs by their name in the catalogue, or [min, max]"
    )
    keep_out: KeepOuts = Field(default={})
    prices: dict[Name, Price] = Field(
        default={}, description="prices of LiDARs by their name in the catalogue, in any currency"
    )
    constraints: LimitSettings = Field(LimitSettings(), description="limits of a rig")
    requirements: Requirements = Field((), description="what a rig must see around the vehicle")
    allow_blind_lidars: bool = Field(
        False, description="whether LiDARs may see neither ground nor objects in the ROI"
    )

    @field_validator("scene")
    @classmethod
    def _at_a_site(cls, scene: Scene | None, info: ValidationInfo) -> Scene | None:
        if scene is not None and info.data.get("site") is None:
            raise InputError("is of a site", fix="set site, or name a log with --log")
        return scene

    @field_validator("zones", mode="before")
    @classmethod
    def _along_kerbs(cls, zones: Any, info: ValidationInfo) -> Any:
        site = info.data.get("site")
        scene = info.data.get("scene") or simulated_scene()
        return zones if site is None else with_strips(zones, scene, site)

    @model_validator(mode="after")
    def _is_mountable(self) -> RigsSettings:
        mountable(self.zones, vehicle_of(self.vehicle))
        return self


@dataclass(frozen=True)
class RigsFile:
    """A file that was read, as plain data and validated.

    If `single` it is the file of one placement, with `mounts` at its top."""

    path: Path
    content: Mapping[str, Any]
    settings: RigsSettings
    single: bool = False

    @cached_property
    def rigs(self) -> tuple[Rig, ...]:
        """Rigs in the order of the file."""
        if self.single:
            return (Rig.of_written(self.path.stem, self.content, self.path.parent),)
        placements = self.content.get("placements") or {"mine": {}}
        rigs, folder = placements.items(), self.path.parent
        return tuple(Rig.of_written(str(name), written, folder) for name, written in rigs)

    @property
    def lidar(self) -> SensorSettings:
        """Model of mounts that name none."""
        return self.settings.lidar

    @cached_property
    def zones(self) -> tuple[Zone, ...]:
        """Zones in which LiDARs may sit."""
        zones = self.settings.zones.items()
        return tuple(z for name, zone in zones for z in zone.zones(name, self.vehicle))

    @cached_property
    def counts(self) -> tuple[CountBound, ...]:
        """Bounds on the number of LiDARs: in zones, of models, and of all."""
        settings = self.settings
        bounds = [
            CountBound(f"zones.{name}.lidars", *zone.lidars, zone=name, size=zone.size)
            for name, zone in settings.zones.items()
            if zone.lidars
        ]
        bounds += [CountBound(f"counts.{n}", *c, model=n) for n, c in settings.counts.items()]
        return (*bounds, *([CountBound("lidars", *settings.lidars)] if settings.lidars else []))

    @cached_property
    def limits(self) -> Limits:
        """Limits of mounting."""
        keep_out = keep_out_boxes(self.settings.keep_out)
        return self.settings.constraints.limits(self.vehicle, keep_out, self.zones)

    @property
    def site(self) -> Site | None:
        """The site, if the LiDARs are on poles."""
        return self.settings.site

    @property
    def scene(self) -> Scene:
        """Traffic at the site; half a minute of a generated town unless it is named."""
        return self.settings.scene or simulated_scene()

    @cached_property
    def around(self) -> Obstacles | None:
        """Buildings and lanes around the site; None on a vehicle.

        Raises ValueError as `obstacles_around`."""
        with at(self.path):
            return None if self.site is None else obstacles_around(self.scene, self.site)

    def blocked(self, number: int, position: NDArray[np.float64]) -> str:
        """Return why no pole can hold LiDAR `number` at a position; "" if one can, or on a car."""
        try:
            if self.around is not None:
                self.around.check_place(position, f"LiDAR {number + 1}")
        except InputError as error:
            return str(error)
        return ""

    @cached_property
    def vehicle(self) -> Vehicle:
        """Body of the vehicle alone."""
        return vehicle_of(self.settings.vehicle)

    @cached_property
    def body(self) -> Vehicle:
        """Vehicle that stops rays: the body, and the keep-outs."""
        return vehicle_of(self.carrier_settings)

    @property
    def carrier_settings(self) -> VehicleSettings | None:
        """Settings of the vehicle with its keep-outs, as the key `vehicle` of a sweep."""
        return carrier_of(self.settings.vehicle, self.settings.keep_out)

    @cached_property
    def carrier(self) -> Vehicle | None:
        """Vehicle in clouds; None, a sedan, if the file has neither `vehicle` nor `keep_out`."""
        return None if self.carrier_settings is None else self.body

    @cached_property
    def hiding(self) -> Vehicle:
        """Vehicle that hides objects of requirements: the body, at a site the buildings."""
        with at(self.path):
            if self.site is None:
                return self.body
            return poles_at(self.scene, self.site, self.body).with_walls

    @cached_property
    def layouts(self) -> tuple[RequirementLayout, ...]:
        """Requirements, laid out around what hides objects. Raises ValueError if one cannot be."""
        layouts, curves = [], default_curves()
        for settings in self.settings.requirements:
            with at(self.path), at(f"requirements {settings.name!r}"):
                layouts.append(lay_out(settings.requirement(self.hiding, curves), self.hiding))
        return tuple(layouts)

    def text_with(self, rigs: Sequence[Rig]) -> str:
        """Return the file with these rigs in place of its own; comments are lost."""
        if self.single and len(rigs) == 1:
            return as_yaml({**self.content, **rigs[0].written})
        rest = {} if self.single else self.content
        return as_yaml({**rest, "placements": {rig.name: rig.written for rig in rigs}})


def read_rigs(path: Path) -> RigsFile:
    """Read the keys of `RigsSettings`, or the file of one placement with `mounts`.

    Raises OSError: it cannot be read; ValueError: it is no such file, names file, key and value."""
    content, context = read_yaml_file(path), {"folder": path.parent}
    content = as_rigs(content, path) if is_answer(content) else content or {}
    try:
        if isinstance(content, dict) and "mounts" in content:
            RigSettings.model_validate(content, context=context)
            return RigsFile(path, content, RigsSettings(), single=True)
        return RigsFile(path, content, RigsSettings.model_validate(content, context=context))
    except ValidationError as error:
        raise fault(error, str(path)) from None


def as_yaml(content: Mapping[str, Any]) -> str:
    """Return the text of a file with this content."""
    style: dict[str, Any] = {"sort_keys": False, "default_flow_style": None, "width": 100}
    return str(yaml.safe_dump(dict(content), allow_unicode=True, **style))


def write_rigs(path: Path, text: str, overwrite: bool) -> None:
    """Write a file in one step. Raises FileExistsError: it exists, without `overwrite`."""
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path}: exists; choose overwrite, or another name")
    write_text(path, text)

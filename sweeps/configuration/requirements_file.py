"""A file of requirements: its rigs, and its requirements laid out around the vehicle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from lidarplace.base.errors import InputError, at
from lidarplace.base.number_text import point
from lidarplace.base.plugin_folders import plugin_folder
from lidarplace.base.suggestions import did_you_mean
from lidarplace.clouds.own_body import check_mounts
from lidarplace.configuration.mounting import KeepOuts, KeepOutSettings, carrier_of, keep_out_boxes
from lidarplace.configuration.placement import (
    PlacementSettings,
    read_placement,
    read_placement_settings,
)
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import FilePath, Name, short_for
from lidarplace.configuration.vehicle import OwnVehicle, vehicle_of
from lidarplace.mounting.common_view import check_pairs
from lidarplace.mounting.vehicle import Vehicle, depth_in
from lidarplace.recall.detection_curve import DetectionCurves, default_curves, read_curves
from lidarplace.requirements.layout import RequirementLayout, lay_out
from lidarplace.requirements.requirement import KIND_OF, dead_sets
from lidarplace.requirements.settings import Requirements, RequirementSettings
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Placement
from lidarplace.scenes.kinds import Scene, obstacles_around, poles_at
from lidarplace.scenes.site import Site, SiteOrVehicle
from lidarplace.scenes.sumo.settings import SumoScene
from sweeps.configuration.file import ConfigError, read_yaml
from sweeps.configuration.file import check as check_file
from sweeps.configuration.rigs import check_names


class RequirementsFile(SiteOrVehicle):
    """A file of `lidarplace requirements`: rigs, their vehicle or site, and what has to be seen."""

    lidar: Annotated[SensorSettings, short_for("name")] = Field(
        SensorSettings(), description="the LiDARs, unless a mount has its own"
    )
    vehicle: OwnVehicle = Field(None, description="the body of the vehicle; a car by default")
    site: Site | None = Field(
        None, description="LiDARs on poles beside the road instead of a vehicle, as in a sweep"
    )
    scene: Scene = Field(
        SumoScene(), description="traffic around the site; its lanes and buildings count"
    )
    keep_out: KeepOuts = Field(default={})
    placements: dict[Name, PlacementSettings] = Field(
        default={}, description="own placements by name"
    )
    rigs: tuple[Name, ...] = Field(
        (),
        description="rigs to check: own placements, the paper's by name, FILE.yaml with mounts, "
        "run folders of searches; by default all own ones, or else the paper's eight",
    )
    curves: FilePath | None = Field(
        None,
        description="detection curves, a file of lidarplace calibrate; those of the package "
        "if null",
    )
    requirements: Requirements = Field(min_length=1, description="what has to be seen")

    @model_validator(mode="after")
    def _scene_of_a_site(self) -> Self:
        if self.site is None and "scene" in self.model_fields_set:
            raise InputError("is of a site", key="scene", fix="set site, or remove scene")
        return self


@dataclass(frozen=True)
class RequirementsCheck:
    """Rigs to check against requirements.

    Attributes:
        rigs: of different names.
        vehicle: that carries them, with everything kept out; or the poles of a site.
        layouts: the requirements, laid out around it, at a site with the walls of buildings.
        further: cameras and radars of each rig."""

    rigs: tuple[Placement, ...]
    vehicle: Vehicle
    layouts: tuple[RequirementLayout, ...]
    further: tuple[tuple[MountedSensor, ...], ...]


def read_requirements_check(path: Path, overrides: Sequence[str] = ()) -> RequirementsCheck:
    """Read a file, its rigs and curves, and lay out its requirements.

    Raises ValueError, which names file, key and fault, and OSError."""
    raw = read_yaml(path, overrides, RequirementsFile)
    with at(path, ConfigError), plugin_folder(path.parent):
        file = check_file(RequirementsFile, raw, path)
        curves = default_curves() if file.curves is None else read_curves(file.curves)
        body = vehicle_of(file.vehicle)
        rigs, further = zip(*_rigs(file), strict=True)
        for rig, others in zip(rigs, further, strict=True):
            check_rig_fits(rig, body, file.requirements, others)
            _check_kept_out(rig, file.keep_out)
        vehicle = hiding = vehicle_of(carrier_of(file.vehicle, file.keep_out))
        if file.site is not None:
            _check_poles(rigs, file.scene, file.site)
            vehicle = poles_at(file.scene, file.site, vehicle)
            hiding = vehicle.with_walls
        layouts = lay_out_requirements(file.requirements, hiding, curves)
        return RequirementsCheck(rigs, vehicle, layouts, further)


def _check_poles(rigs: Sequence[Placement], scene: Scene, site: Site) -> None:
    """Raise ValueError for a LiDAR in a building, on a lane, or too high, and without a site."""
    around = obstacles_around(scene, site)
    with at(key="rigs"):
        for rig in rigs:
            around.check(rig)


def lay_out_requirements(
    requirements: Sequence[RequirementSettings],
    vehicle: Vehicle,
    curves: DetectionCurves,
    key: str = "requirements",
) -> tuple[RequirementLayout, ...]:
    """Lay out each of the requirements of a key around the vehicle. Raises InputError."""
    layouts = []
    for number, settings in enumerate(requirements):
        with at(key=f"{key}[{number}] {settings.name!r}"):
            layouts.append(lay_out(settings.requirement(vehicle, curves), vehicle))
    return tuple(layouts)


def _rigs(file: RequirementsFile) -> list[tuple[Placement, tuple[MountedSensor, ...]]]:
    lidar = file.lidar.lidar()
    check_names(file.placements)
    names = file.rigs or tuple(file.placements) or tuple(PAPER_PLACEMENTS)
    if len(set(names)) < len(names):
        raise InputError("duplicates", key="rigs", found=", ".join(names))
    rigs = []
    for name in names:
        if name in file.placements:
            settings = file.placements[name]
            with at(key=f"placements.{name}"):
                rigs.append(
                    (settings.placement(name, lidar, file.lidar.losses), settings.further())
                )
        elif name in PAPER_PLACEMENTS:
            rigs.append((PAPER_PLACEMENTS[name].with_lidar(lidar), ()))
        elif Path(name).is_dir() or name.endswith((".yaml", ".yml")):
            path = Path(name) / "placement.yaml" if Path(name).is_dir() else Path(name)
            rig = replace(read_placement(path, lidar), name=name)
            with at(path):
                rigs.append((rig, read_placement_settings(path).further()))
        else:
            names_known = [*file.placements, *PAPER_PLACEMENTS]
            problem = f"no placement {name!r}{did_you_mean(name, names_known)}"
            expected = f"{', '.join(names_known)}, a FILE.yaml, a run folder"
            raise InputError(problem, key="rigs", expected=expected)
    return rigs


def _check_kept_out(rig: Placement, keep_out: Mapping[str, KeepOutSettings]) -> None:
    for name, box in zip(keep_out, keep_out_boxes(keep_out), strict=True):
        for number, mount in enumerate(rig.mounts, start=1):
            if depth_in(box[None], np.array([mount.position])).any():
                problem = f"LiDAR {number} at {point(*mount.position)} is inside keep_out.{name}"
                raise InputError(problem, key=repr(rig.name))


def check_rig_fits(
    rig: Placement,
    vehicle: Vehicle,
    requirements: Sequence[RequirementSettings],
    further: Sequence[MountedSensor] = (),
) -> None:
    """Raise ValueError if a LiDAR is inside of the vehicle's body, and as `check_lidars`."""
    check_lidars(rig, requirements)
    kinds = ["lidar"] * len(rig.mounts) + [sensor.kind for sensor in further]
    for requirement in requirements:
        check_dead_sensors(requirement, kinds)
        if requirement.common_view is not None:
            with at(key=f"{requirement.name!r}: {rig.name!r}"):
                check_pairs(requirement.common_view.view(), len(kinds))
    check_mounts(rig, vehicle)


def check_lidars(rig: Placement, requirements: Sequence[RequirementSettings]) -> None:
    """Raise ValueError if a LiDAR cannot be checked, as `RequirementSettings.not_of` reports."""
    for requirement in requirements:
        for number, lidar in enumerate(rig.lidars, start=1):
            if (unsupported := requirement.not_of(lidar)) is not None:
                key, reason = unsupported
                problem = f"LiDAR {number} of {rig.name!r}: {reason}"
                raise InputError(problem, key=f"{requirement.name!r}: {key}")


def check_dead_sensors(requirement: RequirementSettings, kinds: Sequence[str]) -> None:
    """Raise ValueError if sensors of a rig, of these kinds, can be dead in too many ways."""
    needs = () if requirement.at_least is None else requirement.at_least.needs
    count = {KIND_OF.get(measure, "lidar") for measure, _ in needs}
    with at(key=f"{requirement.name!r}: also_when.sensors_dead"):
        dead_sets(requirement.also_when.sensors_dead or 0, sum(kind in count for kind in kinds))

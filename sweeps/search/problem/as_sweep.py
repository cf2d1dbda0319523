"""Rigs of a search as those of a sweep, which trains detectors for them."""

import itertools
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from lidarplace.base.errors import at
from lidarplace.configuration.mounting import carrier_of
from lidarplace.configuration.placement import MountSettings, SweptPlacementSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.vehicle import VehicleSettings
from sweeps.configuration.file import ConfigError, check, put
from sweeps.configuration.grid import GridPoint, Sweep
from sweeps.configuration.rigs import Rigs
from sweeps.configuration.search import SearchFile
from sweeps.configuration.sweep import Point
from sweeps.search.problem.choice import Choice, Choices

_OWN = ("search", "robustness", "verify", "placement")


@dataclass(frozen=True)
class SearchConfig:
    """The file `path` of a search after `--set`, as plain data and checked; and its sweeps."""

    path: Path
    source: Mapping[str, Any]
    file: SearchFile

    def placement_settings(self, rig: Choices) -> SweptPlacementSettings:
        """A rig as one of `placements`; mounts have their model, if it is not that of all."""
        search = self.file.search
        own: dict[str, Any] = {"mounts": [self._mounted(lidar) for lidar in rig if not lidar.dead]}
        dead = [self._mounted(lidar) for lidar in rig if lidar.dead]
        rest = {"dead": dead, "cameras": search.cameras, "radars": search.radars}
        own |= {key: value for key, value in rest.items() if value}
        return SweptPlacementSettings.model_validate(own)

    def placement_text(self, rig: Choices) -> str:
        """A rig as a file for `lidarplace view` and others, metres and radians."""
        settings = as_plain(self.placement_settings(rig))
        # Read by itself, the file has to say what the key `lidar` says here.
        own = self.file.lidar.model_dump(
            mode="json", exclude_unset=True, include=set(SensorSettings.model_fields)
        )
        for mount in settings["mounts"]:
            mount.setdefault("lidar", deepcopy(own))  # one object would become a YAML anchor
        return yaml.safe_dump(settings, sort_keys=False)

    def _mounted(self, lidar: Choice) -> MountSettings:
        pose = {key: value for key, value in asdict(lidar.mount).items() if key in "xyz" or value}
        model = self.file.search.models.get(lidar.model)
        return MountSettings(**pose, **({} if model is None else {"lidar": model}))

    @cached_property
    def vehicle(self) -> VehicleSettings | None:
        """The vehicle as that of a sweep, with what is kept out. None if the search says neither:
        clouds then have the sedan of sweeps."""
        return carrier_of(self.file.search.vehicle, self.file.search.keep_out)

    def point(self, changes: Mapping[str, Any], names: Mapping[str, str]) -> Point:
        """A point of a sweep with `changes`, key path -> value, which the user wrote as `names`;
        sections that are changed are read again. Raises ConfigError: a value is not allowed."""
        data = {key: getattr(self.file, key) for key in Point.model_fields}
        data["vehicle"] = self.vehicle
        for key in {changed.partition(".")[0] for changed in changes}:
            if key in self.source:
                data[key] = self.source[key]
            elif isinstance(section := data[key], BaseModel):
                data[key] = section.model_dump(mode="json", exclude_defaults=True)
        with at(self.path, ConfigError):
            return check(Point, data, self.path, names, changes)

    def sweep_of(
        self, rigs: Mapping[str, Choices], trials: Sequence[str], changes: Mapping[str, Any]
    ) -> Sweep:
        """The trainings that `trials` need, with the seeds of the search and `changes`, key path ->
        value. `rigs`: by name of the placement; a generalist can name those without a trial. Raises
        ConfigError: a value is not allowed."""
        own = {name: self.placement_settings(rig) for name, rig in rigs.items()}
        known = Rigs({**self.file.placements, **own}, self.file)
        names = {key: f"search.traffic: {key}" for key in changes}
        points = []
        for name, seed in itertools.product(trials, self.file.search.seeds):
            axes = {"placement": name, "seed": seed}
            point = self.point({**axes, **changes}, names)
            points.append(GridPoint(point, known.of(point), axes))
        return Sweep(self.file, tuple(points), ("placement", "seed"), self.source, known, self.path)

    def verify_settings(self, rigs: Mapping[str, Choices], others: Sequence[str]) -> dict[str, Any]:
        """The configuration, as a file has it, of a sweep that trains detectors for rigs. `others`:
        names of placements that a sweep knows, which are trained, too."""
        source, file = self.source, self.file
        config = {key: deepcopy(value) for key, value in source.items() if key not in _OWN}
        own = {name: as_plain(self.placement_settings(rig)) for name, rig in rigs.items()}
        config["placements"] = config.get("placements", {}) | own
        if self.vehicle is not None:
            config["vehicle"] = as_plain(self.vehicle)
        # A sweep has other defaults.
        config["mounting_errors"] = file.mounting_errors.model_dump(mode="json", exclude_none=True)
        config["name"] = f"{file.name}-verify"
        config.setdefault("detector", file.detector)
        config["grid"] = {"placement": [*rigs, *others]}
        if file.search.requirements:
            config["requirements"] = deepcopy(source["search"]["requirements"])
        if file.verify is not None:
            config["grid"]["seed"] = list(file.verify.seeds)
            for key, value in file.verify.set.items():
                put(config, key, value)
        return config


def as_plain(settings: BaseModel) -> dict[str, Any]:
    """Settings as a file has them, without what they leave to the default."""
    return settings.model_dump(mode="json", exclude_unset=True)

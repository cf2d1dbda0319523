"""Sweeps that a search starts: trials of a generalist, and the verification of the winners."""

import itertools
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from lidarplace import Lidar
from lidarplace.base.errors import at
from lidarplace.configuration.answer import studio_content
from lidarplace.configuration.mounting import carrier_of
from lidarplace.configuration.placement import MountSettings, SweptPlacementSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.vehicle import VehicleSettings
from lidarplace.rig_files.mounts_yaml import as_written
from sweeps.configuration.file import ConfigError, check, public_yaml, put
from sweeps.configuration.grid import GridPoint, Sweep
from sweeps.configuration.point import Point
from sweeps.configuration.rigs import Rigs
from sweeps.configuration.search import SearchFile
from sweeps.search.problem.rig import MountedLidar, Rig, placement_of

_ABOUT = """\
# A rig, and the search that chose it. lidarplace requirements, studio, run, search, cheapest, view
# and rig read this file as it is.
"""
_OWN = ("search", "robustness", "verify", "placement")


@dataclass(frozen=True)
class SearchConfig:
    """The file of a search, `path`, after `--set`: as plain data, validated, and its sweeps.

    `models`: LiDARs in the weather, by name."""

    path: Path
    source: Mapping[str, Any]
    file: SearchFile
    models: Mapping[str, Lidar]

    def placement_settings(self, rig: Rig) -> SweptPlacementSettings:
        """Return a rig as one of `placements`; mounts have a model unless it is that of `lidar`."""
        search = self.file.search
        settings = {
            "mounts": [self._mounted(lidar) for lidar in rig if not lidar.dead],
            "dead": [self._mounted(lidar) for lidar in rig if lidar.dead],
            "cameras": search.cameras,
            "radars": search.radars,
        }
        return SweptPlacementSettings.model_validate({k: v for k, v in settings.items() if v})

    def placement_text(self, rig: Rig) -> str:
        """Write a rig with its search as a file that all commands read, metres and radians.

        LiDARs of the catalogue have their name alone."""
        return _ABOUT + public_yaml(self._readable(rig) | dict(self.source))

    def rigs_text(self, rigs: Mapping[str, Rig]) -> str:
        """Write rigs with vehicle, zones, prices, limits and requirements, as a studio's file."""
        placements = {name: self._readable(rig) for name, rig in rigs.items()}
        content = studio_content(self.source, placements)
        return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100))

    def _readable(self, rig: Rig) -> dict[str, Any]:
        """Return a rig as in a file by itself, with a model on each mount."""
        settings = as_plain(self.placement_settings(rig))
        # Read by itself, the file has to say what the key `lidar` says here.
        lidar = self.file.lidar.model_dump(
            exclude_unset=True, include={*SensorSettings.model_fields}
        )
        for mount in settings["mounts"]:
            model = SensorSettings.model_validate(mount.get("lidar", lidar))
            written = as_written(model)
            if losses := dict(self.file.lidar.losses):
                losses |= {k: getattr(model, k) for k in losses.keys() & model.model_fields_set}
                written = losses | ({"name": written} if isinstance(written, str) else written)
            mount["lidar"] = written
        return settings

    def _mounted(self, lidar: MountedLidar) -> MountSettings:
        pose = {key: value for key, value in asdict(lidar.mount).items() if key in "xyz" or value}
        model = self.file.search.models.get(lidar.model)
        return MountSettings(**pose, **({} if model is None else {"lidar": model}))

    @cached_property
    def vehicle(self) -> VehicleSettings | None:
        """The vehicle as that of a sweep, with what is kept out.

        None if the search has neither: clouds then have the sedan of sweeps."""
        return carrier_of(self.file.search.vehicle, self.file.search.keep_out)

    def point(self, changes: Mapping[str, Any], names: Mapping[str, str]) -> Point:
        """Return a point of a sweep with `changes`, key path -> value.

        `names`: what the user wrote the changed keys as, for errors. Raises ConfigError: a value is
        not allowed."""
        data = {key: getattr(self.file, key) for key in Point.model_fields}
        data["vehicle"] = self.vehicle
        with at(self.path, ConfigError):
            return check(Point, data, self.path, names, changes)

    def sweep_of(
        self, rigs: Mapping[str, Rig], trials: Sequence[str], changes: Mapping[str, Any]
    ) -> Sweep:
        """Return the sweep of the trainings that `trials` need, with the seeds of the search.

        `rigs`: by name of the placement; a generalist can name those without a trial. `changes`:
        key path -> value. Raises ConfigError: a value is not allowed."""
        placements = {name: placement_of(rig, self.models, name) for name, rig in rigs.items()}
        all_rigs = Rigs(self.file.placements, self.file, placements)
        names = {key: f"search.traffic: {key}" for key in changes}
        points = []
        for name, seed in itertools.product(trials, self.file.search.seeds):
            axes = {"placement": name, "seed": seed}
            point = self.point({**axes, **changes}, names)
            points.append(GridPoint(point, all_rigs.of(point), axes))
        return Sweep(
            self.file, tuple(points), ("placement", "seed"), self.source, all_rigs, self.path
        )

    def verify_settings(self, rigs: Mapping[str, Rig], others: Sequence[str]) -> dict[str, Any]:
        """Return the configuration, as a file has it, of a sweep that trains detectors for rigs.

        `others`: names of placements that a sweep knows, which are trained, too."""
        source, file = self.source, self.file
        config = {key: deepcopy(value) for key, value in source.items() if key not in _OWN}
        placements = {name: as_plain(self.placement_settings(rig)) for name, rig in rigs.items()}
        if not file.needs_voxels:  # a sweep does
            config["roi"] = file.roi.model_dump(mode="json", include={"x", "y", "z"})
        config["placements"] = config.get("placements", {}) | placements
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
    """Return settings as a file has them, without values left to the default."""
    return settings.model_dump(mode="json", exclude_unset=True)

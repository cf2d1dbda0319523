"""Rigs of a search as those of a sweep, which trains detectors for them."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from lidarplace.configuration.placement import MountSettings, SweptPlacementSettings
from lidarplace.configuration.vehicle import VehicleSettings
from sweeps.configuration.file import check, put
from sweeps.configuration.grid import GridPoint, Sweep
from sweeps.configuration.rigs import Rigs
from sweeps.configuration.search import SearchFile
from sweeps.configuration.sweep import Point
from sweeps.search.problem.choice import Choice, Choices
from sweeps.search.problem.constraints import with_keep_outs

_OWN = ("search", "robustness", "verify", "placement")


def placement_settings(rig: Choices, search: SearchFile) -> SweptPlacementSettings:
    """A rig as one of `placements`; mounts have their model, if it is not that of all."""

    def mounted(lidar: Choice) -> MountSettings:
        pose = {key: value for key, value in asdict(lidar.mount).items() if key in "xyz" or value}
        model = search.search.models.get(lidar.model)
        return MountSettings(**pose) if model is None else MountSettings(**pose, lidar=model)

    dead = [mounted(lidar) for lidar in rig if lidar.dead]
    mounts = [mounted(lidar) for lidar in rig if not lidar.dead]
    return SweptPlacementSettings(mounts=mounts, **({"dead": dead} if dead else {}))


def own_vehicle(search: SearchFile) -> VehicleSettings | None:
    """The vehicle of a search as that of a sweep: its keep-outs are boxes of it.

    None if the search says neither: clouds then have the sedan of sweeps.
    """
    told = search.search.vehicle
    if told is None and not search.search.keep_out:
        return None
    own = {} if told is None else told.model_dump(exclude_defaults=True)
    boxes = with_keep_outs(search.search).boxes.tolist()
    return VehicleSettings.model_validate(own | ({"boxes": boxes} if boxes else {}))


def verify_settings(
    source: Mapping[str, Any],
    search: SearchFile,
    rigs: Mapping[str, Choices],
    others: Sequence[str],
    values: Mapping[str, Any],
) -> dict[str, Any]:
    """The configuration, as plain data, of a sweep that trains detectors for `rigs` and `others`.

    Args:
        source: the configuration of the search, as plain data.
        search: the same, checked.
        others: names of placements that a sweep knows.
        values: key path -> value, what was found beside the rig.
    """
    config = {key: copy.deepcopy(value) for key, value in source.items() if key not in _OWN}
    own = {name: as_plain(placement_settings(rig, search)) for name, rig in rigs.items()}
    config["placements"] = config.get("placements", {}) | own
    if (vehicle := own_vehicle(search)) is not None:
        config["vehicle"] = as_plain(vehicle)
    # A sweep has other defaults.
    config["mounting_errors"] = search.mounting_errors.model_dump(mode="json", exclude_none=True)
    config["name"] = f"{search.name}-verify"
    config.setdefault("detector", search.detector)
    config["grid"] = {"placement": [*rigs, *others]}
    if search.search.requirements:
        config["requirements"] = copy.deepcopy(source["search"]["requirements"])
    changes = dict(values)
    if search.verify is not None:
        config["grid"]["seed"] = list(search.verify.seeds)
        changes |= search.verify.set
    for key, value in changes.items():
        put(config, key, value, Path(search.name))
    return config


def as_plain(settings: BaseModel) -> dict[str, Any]:
    """Settings as a file has them, without what they leave to the default."""
    return settings.model_dump(mode="json", exclude_unset=True)


def point_of(
    source: Mapping[str, Any],
    search: SearchFile,
    path: Path,
    changes: Mapping[str, Any],
    names: Mapping[str, str],
) -> Point:
    """A point of a sweep with the settings of a search; sections that are changed are read again.

    Args:
        source: the configuration of the search, as plain data.
        search: the same, checked.
        path: of the configuration, for messages.
        changes: key path -> value.
        names: what the user wrote key paths as.

    Raises:
        ConfigError: a value is not allowed at its key path.
    """
    data = {key: getattr(search, key) for key in Point.model_fields}
    data["vehicle"] = own_vehicle(search)
    for key in {changed.partition(".")[0] for changed in changes}:
        if key in source:
            data[key] = source[key]
        elif isinstance(section := data[key], BaseModel):
            data[key] = section.model_dump(mode="json", exclude_defaults=True)
    return check(Point, data, path, names, changes)


def sweep_of(
    source: Mapping[str, Any],
    search: SearchFile,
    path: Path,
    rigs: Mapping[str, Choices],
    trials: Mapping[str, Mapping[str, Any]],
    rung: Mapping[str, Any],
) -> Sweep:
    """The trainings that some trials of a search need, with the seeds of the search.

    Args:
        source, search, path: see `point_of`.
        rigs: by name of the placement; those without a trial can be named by a generalist.
        trials: name of the placement -> values by key path.
        rung: key path -> value, what is different about these trainings.

    Raises:
        ConfigError: a value is not allowed at its key path.
    """
    own = {name: placement_settings(rig, search) for name, rig in rigs.items()}
    known = Rigs({**search.placements, **own}, search)
    points = []
    for name, values in trials.items():
        names = {key: f"search.space.{key}" for key in values}
        names |= {key: f"search.rungs or search.traffic: {key}" for key in rung}
        for seed in search.search.seeds:
            axes = {"placement": name, "seed": seed}
            point = point_of(source, search, path, axes | dict(values) | dict(rung), names)
            points.append(GridPoint(point, known.of(point), axes))
    return Sweep(search, tuple(points), ("placement", "seed"), source, known)

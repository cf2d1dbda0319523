"""Rigs of a search as the configuration of a sweep, which trains detectors for them."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sweeps.configuration.file import check, put
from sweeps.configuration.grid import GridPoint, Sweep
from sweeps.configuration.search import TOTALS, SearchFile
from sweeps.configuration.sweep import Point, SweepFile
from sweeps.search.problem.choice import Choice, Choices
from sweeps.search.problem.constraints import with_keep_outs

_OWN = ("search", "robustness", "verify", "placement")


def mount_settings(lidar: Choice, search: SearchFile) -> dict[str, Any]:
    """One LiDAR as a mount of `placements`; with its model, if it is not that of all."""
    pose = {key: value for key, value in asdict(lidar.mount).items() if key in "xyz" or value}
    if lidar.model not in search.search.models:
        return pose
    model = search.search.models[lidar.model]
    return pose | {"lidar": model.model_dump(mode="json", exclude_unset=True, exclude={*TOTALS})}


def placement_settings(rig: Choices, search: SearchFile) -> dict[str, Any]:
    """A rig as one of `placements`."""
    dead = [mount_settings(lidar, search) for lidar in rig if lidar.dead]
    mounts = [mount_settings(lidar, search) for lidar in rig if not lidar.dead]
    return {"mounts": mounts} | ({"dead": dead} if dead else {})


def own_vehicle(search: SearchFile) -> dict[str, Any]:
    """The key `vehicle` of a sweep for the vehicle of a search, whose keep-outs are boxes of it.

    Nothing if the search says neither: clouds then have the sedan of sweeps.
    """
    told = search.search.vehicle
    if told is None and not search.search.keep_out:
        return {}
    own = {} if told is None else told.model_dump(mode="json", exclude_defaults=True)
    boxes = with_keep_outs(search.search).boxes.tolist()
    return {"vehicle": own | ({"boxes": boxes} if boxes else {})}


def sweep_settings(
    source: Mapping[str, Any], search: SearchFile, rigs: Mapping[str, Choices], name: str
) -> dict[str, Any]:
    """The configuration of a sweep of `rigs`, without its grid.

    Args:
        source: the configuration of the search, as plain data.
        search: the same, checked.
        name: of the sweep.
    """
    config = {k: copy.deepcopy(v) for k, v in source.items() if k not in _OWN}
    own = {key: placement_settings(rig, search) for key, rig in rigs.items()}
    config["placements"] = config.get("placements", {}) | own
    config |= own_vehicle(search)
    # A sweep has other defaults.
    config["mounting_errors"] = search.mounting_errors.model_dump(mode="json", exclude_none=True)
    return config | {"name": name}


def verify_settings(
    source: Mapping[str, Any],
    search: SearchFile,
    rigs: Mapping[str, Choices],
    others: Sequence[str],
    values: Mapping[str, Any],
) -> dict[str, Any]:
    """The configuration of a sweep that trains detectors for `rigs` and for the `others`.

    Args:
        others: names of placements that a sweep knows.
        values: key path -> value, what was found beside the rig.
    """
    config = sweep_settings(source, search, rigs, f"{search.name}-verify")
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


def sweep_of(
    config: Mapping[str, Any],
    path: Path,
    trials: Mapping[str, Mapping[str, Any]],
    seeds: Sequence[int],
    rung: Mapping[str, Any],
) -> Sweep:
    """The trainings that some trials of a search need.

    Args:
        config: from `sweep_settings`.
        path: of the configuration, for messages.
        trials: name of the placement -> values by key path.
        seeds: of the trainings of each trial.
        rung: key path -> value, what is shorter about these trainings.

    Raises:
        ConfigError: a value is not allowed at its key path.
    """
    checked = check(SweepFile, dict(config) | {"placement": "line"}, path)
    base = {key: config[key] for key in config if key in Point.model_fields}
    points = []
    for name, values in trials.items():
        for seed in seeds:
            data = copy.deepcopy(base) | {"placement": name, "seed": seed}
            for key, value in (dict(values) | dict(rung)).items():
                put(data, key, value, path)
            names = {key: f"search.space.{key}" for key in values}
            names |= {key: f"search.rungs or search.traffic: {key}" for key in rung}
            axes = {"placement": name, "seed": seed}
            point = check(Point, data, path, names)
            points.append(GridPoint(point, checked.rig_named(name, point), axes))
    return Sweep(checked, tuple(points), ("placement", "seed"), config)

"""Answers of searches: files of a rig, `mounts`, with all keys of the search that chose it."""

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from lidarplace.configuration.mounting import REAL_MOUNTS, KeepOuts, carrier_of
from lidarplace.configuration.placement import PlacementSettings
from lidarplace.configuration.settings import Settings, validated
from lidarplace.configuration.vehicle import OwnVehicle
from lidarplace.configuration.zones import AngleSettings

_OF_SEARCHES = ("search", "robustness", "verify", "placement", "placements")
ALLOWANCES = ("zones", "lidars", "counts", "prices", "constraints", "allow_blind_lidars")
"""Keys of a file of `lidarplace studio` that requirements do not depend on."""


class _Carrier(Settings):
    """Vehicle of a search."""

    vehicle: OwnVehicle = None
    keep_out: KeepOuts = Field(default={})


def is_answer(raw: Any) -> bool:
    """Return whether plain data of a file is a rig together with a search."""
    return isinstance(raw, dict) and "mounts" in raw and isinstance(raw.get("search"), dict)


def rig_of(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return the rig of an answer, as one of `placements`."""
    return {key: value for key, value in raw.items() if key in PlacementSettings.model_fields}


def as_requirements(raw: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return an answer as a file of `lidarplace requirements`."""
    search, curves = _search_of(raw), (raw.get("surrogate") or {}).get("curves")
    shared = {key: search[key] for key in ("vehicle", "keep_out", "requirements") if key in search}
    content: dict[str, Any] = {"placements": {path.stem: rig_of(raw)}} | shared
    if raw.get("site") is not None:
        content |= {key: raw[key] for key in ("site", "scene") if key in raw}
    return content | ({"curves": curves} if curves else {})


def as_rigs(raw: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return an answer as a file of `lidarplace studio`."""
    return studio_content(raw, {path.stem: rig_of(raw)})


def studio_content(raw: Mapping[str, Any], rigs: Mapping[str, Any]) -> dict[str, Any]:
    """Return rigs with what a search allows as a file of `lidarplace studio`.

    A studio knows models by their names in the catalogue. Bounds of models without such a name, or
    that share one, are left out. Fixed LiDARs have zones, and count, too."""
    search = _search_of(raw)
    content: dict[str, Any] = {"placements": dict(rigs)}
    keys = ("keep_out", "constraints", "requirements")
    content |= {key: deepcopy(search[key]) for key in keys if search.get(key)}
    if raw.get("site") is not None:
        content |= {"site": deepcopy(raw["site"]), "scene": deepcopy(raw.get("scene") or {})}
    elif search.get("vehicle") is not None:  # [] is none, not a car
        content["vehicle"] = deepcopy(search["vehicle"])
    if raw.get("allow_blind_lidars"):
        content["allow_blind_lidars"] = True
    models, fixed = search.get("models") or {}, search.get("fixed") or []
    models = {
        n: model if isinstance(model, dict) else {"name": model} for n, model in models.items()
    }
    names = {name: model.get("name") for name, model in models.items()}
    turns = _turns(search)
    content["zones"] = {n: turns | _zone(zone, names) for n, zone in search["zones"].items()}
    for number, mount in enumerate(fixed, start=1):
        spot = {axis: mount[axis] for axis in "xyz" if axis in mount}
        content["zones"][f"fixed {number}"] = {"x": 0, "y": 0, "standoff": None} | spot
    if (lidars := search.get("lidars")) is not None:
        ends = lidars if isinstance(lidars, (list, tuple)) else (lidars, lidars)
        content["lidars"] = [end + len(fixed) for end in ends]
    used = [*names.values(), *(names.get(mount.get("model")) for mount in fixed)]
    content["counts"] = {
        names[name]: model["count"]
        for name, model in models.items()
        if model.get("count") is not None and names[name] and used.count(names[name]) == 1
    }
    content["prices"] = {
        m["name"]: m["price"] for m in models.values() if {"name", "price"} <= {*m}
    }
    return content


def _search_of(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return the search of an answer; at a site it has no vehicle, not a car."""
    search: dict[str, Any] = raw["search"]
    return search if raw.get("site") is None else search | {"vehicle": []}


def _turns(search: Mapping[str, Any]) -> dict[str, Any]:
    """Return the angles that all zones of a search share; of symmetric rigs with mirror images."""
    turns = {key: search[key] for key in AngleSettings.model_fields if key in search}
    for key in {"roll_deg", "yaw_deg"} & turns.keys() if search.get("symmetric") else ():
        most = float(np.abs(turns[key]).max())
        turns[key] = [-most, most]
    return turns


def _zone(zone: Mapping[str, Any], names: Mapping[str, str | None]) -> dict[str, Any]:
    """Return a zone of a search as one of a studio, its models by their names in the catalogue."""
    rest = {key: deepcopy(value) for key, value in zone.items() if key != "models"}
    models = zone.get("models") or {}
    models = models if isinstance(models, dict) else {key: {} for key in models}
    if models and all(names.get(name) for name in models):
        rest["models"] = {names[name]: deepcopy(angles) for name, angles in models.items()}
    return rest


def as_sweep(raw: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return an answer as a sweep of its rig alone.

    Raises InputError: its vehicle or a keep-out is wrong."""
    search = raw["search"]
    carried = validated(
        _Carrier,
        {key: search[key] for key in _Carrier.model_fields if key in search},
        f"{path}: search",
        path.parent,
    )
    sweep = {key: value for key, value in _rest(raw, "rig").items() if key not in _OF_SEARCHES}
    if (vehicle := carrier_of(carried.vehicle, carried.keep_out)) is not None:
        sweep["vehicle"] = vehicle.model_dump(mode="json", exclude_unset=True)
    if search.get("requirements"):
        sweep["requirements"] = search["requirements"]
    errors = REAL_MOUNTS.model_dump(exclude_unset=True)
    roi = {"fit": "nearest"} | (raw.get("roi") or {})
    rig = {"placement": path.stem, "placements": {path.stem: rig_of(raw)}, "roi": roi}
    return {"mounting_errors": errors} | sweep | rig


def as_search(raw: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return an answer as a search that starts with its rig."""
    placements = (raw.get("placements") or {}) | {path.stem: rig_of(raw)}
    start = [path.stem, *(raw["search"].get("start") or [])]
    return _rest(raw, "next") | {
        "placements": placements,
        "search": raw["search"] | {"start": start},
    }


def _rest(raw: Mapping[str, Any], ending: str) -> dict[str, Any]:
    """Return the keys of an answer without the rig; its new name keeps the folder of the search."""
    rest = {key: value for key, value in raw.items() if key not in PlacementSettings.model_fields}
    return rest | ({"name": f"{raw['name']}-{ending}"} if "name" in raw else {})

"""Answers of searches: files of a rig, `mounts`, with all keys of the search that chose it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from lidarplace.configuration.mounting import KeepOuts, PlaceSettings, carrier_of
from lidarplace.configuration.placement import PlacementSettings
from lidarplace.configuration.settings import Settings, validated
from lidarplace.configuration.vehicle import OwnVehicle

_OF_SEARCHES = ("search", "robustness", "verify", "placement", "placements")


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
    search, curves = raw["search"], (raw.get("surrogate") or {}).get("curves")
    shared = {key: search[key] for key in ("vehicle", "keep_out", "requirements") if key in search}
    return {"placements": {path.stem: rig_of(raw)}, **shared} | (
        {"curves": curves} if curves else {}
    )


def as_rigs(raw: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return an answer as a file of `lidarplace studio`, prices by the names of the catalogue."""
    search = raw["search"]
    keys = ("vehicle", "keep_out", "constraints", "requirements")
    content = {"placements": {path.stem: rig_of(raw)}}
    content |= {key: search[key] for key in keys if search.get(key)}
    content["zones"] = {
        name: {key: value for key, value in zone.items() if key in PlaceSettings.model_fields}
        for name, zone in search["zones"].items()
    }
    models = (model for model in (search.get("models") or {}).values() if isinstance(model, dict))
    content["prices"] = {m["name"]: m["price"] for m in models if "name" in m and "price" in m}
    return content


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
    sweep = {key: value for key, value in _rest(raw).items() if key not in _OF_SEARCHES}
    if (vehicle := carrier_of(carried.vehicle, carried.keep_out)) is not None:
        sweep["vehicle"] = vehicle.model_dump(mode="json", exclude_unset=True)
    if search.get("requirements"):
        sweep["requirements"] = search["requirements"]
    errors = {"offset": 0.01, "angle_deg": 0.5}  # the default of searches
    roi = {"fit": "nearest"} | (raw.get("roi") or {})
    rig = {"placement": path.stem, "placements": {path.stem: rig_of(raw)}, "roi": roi}
    return {"mounting_errors": errors} | sweep | rig


def as_search(raw: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return an answer as a search that starts with its rig."""
    placements = (raw.get("placements") or {}) | {path.stem: rig_of(raw)}
    start = [path.stem, *(raw["search"].get("start") or [])]
    return _rest(raw) | {"placements": placements, "search": raw["search"] | {"start": start}}


def _rest(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of an answer without the rig; the name is new, so the search is kept."""
    rest = {key: value for key, value in raw.items() if key not in PlacementSettings.model_fields}
    return rest | ({"name": f"{raw['name']}-next"} if "name" in raw else {})

"""The kinds of scenes that a configuration can name."""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BaseModel, GetJsonSchemaHandler, SerializeAsAny, ValidationInfo
from pydantic.functional_validators import ModelWrapValidatorHandler, WrapValidator
from pydantic_core import CoreSchema, PydanticCustomError

from lidarplace.base.errors import InputError
from lidarplace.base.registry import Registry
from lidarplace.base.suggestions import did_you_mean
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.recorded import LogScene, log_parts
from lidarplace.scenes.routes import KEEP_M
from lidarplace.scenes.site import Obstacles, Poles, Site
from lidarplace.scenes.sumo.junction import obstacles_at
from lidarplace.scenes.sumo.record import town_parts
from lidarplace.scenes.sumo.settings import SumoScene


class SceneKind(NamedTuple):
    """Kind of scenes: its settings, and the function that lists its parts, training frames first.

    Settings have `source`, `seed`, `name`, `frame_counts` and `remedy`, as `SumoScene` has them.
    The function takes a `Site`, too, for kinds of this package."""

    settings: type[BaseModel]
    parts: Callable[..., list[ScenePart]]


KINDS = Registry(
    "lidarplace.scenes",
    {"sumo": SceneKind(SumoScene, town_parts), "log": SceneKind(LogScene, log_parts)},
    fits=lambda kind: (
        isinstance(kind, SceneKind)
        and isinstance(kind.settings, type)
        and issubclass(kind.settings, BaseModel)
    ),
)
"""Kinds of scenes by `source`."""


def source_of(scene: Any) -> str:
    """Return the kind of a scene; traffic is simulated unless the configuration names another."""
    source = scene.get("source", "sumo") if isinstance(scene, Mapping) else None
    return str(source or getattr(scene, "source", "sumo"))


def _checked(scene: Any, _: ModelWrapValidatorHandler[Any], info: ValidationInfo) -> Any:
    source = source_of(scene)
    if source not in KINDS.own and KINDS.path(source) is None:
        raise PydanticCustomError(
            "scene_source",
            "source: expected {known}{hint}",
            {"known": ", ".join(KINDS.installed()), "hint": did_you_mean(source, KINDS)},
        )
    kind = KINDS[source]
    with KINDS.calls(source, ValueError, OSError):
        return kind.settings.model_validate(scene, context=info.context)


class _Schema:
    """JSON schema of a scene: one of those that are installed."""

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        schema = handler(core)
        added = (kind.settings for name, kind in KINDS.installed().items() if name not in KINDS.own)
        return {"anyOf": [*schema["anyOf"], *(settings.model_json_schema() for settings in added)]}


Scene = Annotated[SerializeAsAny[SumoScene | LogScene], WrapValidator(_checked), _Schema()]
"""A scene of ours, or of a plug-in."""


def scene_parts(scene: Scene, site: Site | None = None) -> list[ScenePart]:
    """List the parts of a scene, as it is seen from a site if there is one.

    Raises ValueError if something that it names is missing."""
    kind = KINDS[scene.source]
    if site is None:
        with KINDS.calls(scene.source, ValueError, OSError):
            return kind.parts(scene)
    _check_has_sites(scene)
    return kind.parts(scene, site)


def _check_has_sites(scene: Scene) -> None:
    if scene.source not in KINDS.own:
        expected = " or ".join(KINDS.own)
        raise InputError("has no sites", key="source", expected=expected, found=scene.source)


def obstacles_around(scene: Scene, site: Site) -> Obstacles:
    """Return buildings and lanes around a site, in its frame; of a log the buildings alone.

    Raises ValueError as `scene_parts`."""
    _check_has_sites(scene)
    return _obstacles(scene, site)


@lru_cache(maxsize=4)
def _obstacles(scene: Scene, site: Site) -> Obstacles:
    if isinstance(scene, SumoScene):
        return obstacles_at(scene, site)
    buildings = scene.read().buildings
    if site.scene is not None:
        buildings = buildings[buildings["scene"] == site.scene]
    pose = (*site.origin, math.radians(site.yaw_deg))
    walls = buildings[list(GEOMETRY)].to_numpy(np.float64)
    return Obstacles.around(pose, walls, np.empty((0, 5)))


def poles_at(scene: Scene, site: Site, keep_outs: Vehicle) -> Poles:
    """Return what carries the LiDARs of a site, among all that is within `KEEP_M` of it.

    `keep_outs`: a vehicle of nothing else. Raises ValueError as `scene_parts`."""
    around = obstacles_around(scene, site).within(KEEP_M)
    return Poles("site", keep_outs.boxes, around=around)

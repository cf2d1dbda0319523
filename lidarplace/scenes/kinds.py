"""The kinds of scenes that a configuration can name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Annotated, Any

from pydantic import BaseModel, Discriminator, Tag

from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.recorded import LogScene, log_parts
from lidarplace.scenes.sumo.parts import town_parts
from lidarplace.scenes.sumo.settings import SumoScene

KINDS: Mapping[str, tuple[type[BaseModel], Callable[[Any], list[ScenePart]]]] = MappingProxyType(
    {
        "sumo": (SumoScene, town_parts),
        "log": (LogScene, log_parts),
    }
)
"""By `source`: the settings of a scene, and what gives its parts, those with training frames
first."""


def _source(scene: Any) -> str:
    """Which kind of scene a configuration means; traffic is simulated unless it says else."""
    if isinstance(scene, dict):
        return str(scene.get("source", "sumo"))
    return str(getattr(scene, "source", "sumo"))


Scene = Annotated[
    Annotated[SumoScene, Tag("sumo")]  # the default
    | Annotated[LogScene, Tag("log")],
    Discriminator(
        _source,
        custom_error_type="scene_source",
        custom_error_message=f"source is none of {', '.join(KINDS)}",
    ),
]
"""A scene of one of these kinds."""


def scene_parts(scene: Scene) -> list[ScenePart]:
    """The parts of a scene. Raises ValueError if something that it names is not there."""
    _, parts = KINDS[scene.source]
    return parts(scene)

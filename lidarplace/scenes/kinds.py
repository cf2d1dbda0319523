"""The kinds of scenes that a configuration can name."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, GetJsonSchemaHandler, SerializeAsAny, ValidationInfo
from pydantic.functional_validators import ModelWrapValidatorHandler, WrapValidator
from pydantic_core import CoreSchema, PydanticCustomError

from lidarplace.base.registry import Registry
from lidarplace.base.suggestions import did_you_mean
from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.recorded import LogScene, log_parts
from lidarplace.scenes.sumo.record import town_parts
from lidarplace.scenes.sumo.settings import SumoScene


class SceneKind(NamedTuple):
    """Kind of scenes: its settings, and the function that lists its parts, training frames first.

    Settings have `source`, `seed`, `name`, `frame_counts` and `remedy`, as `SumoScene` has them."""

    settings: type[BaseModel]
    parts: Callable[[Any], list[ScenePart]]


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


def scene_parts(scene: Scene) -> list[ScenePart]:
    """List the parts of a scene; raise ValueError if something that it names is missing."""
    kind = KINDS[scene.source]
    with KINDS.calls(scene.source, ValueError, OSError):
        return kind.parts(scene)

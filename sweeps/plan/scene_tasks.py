"""What there is to record for a scene: one task a simulation, so that towns run in parallel."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from lidarplace.scenes.recorded import LogScene
from lidarplace.scenes.sumo.maps import find_map
from lidarplace.scenes.sumo.settings import GENERATED, SumoScene
from sweeps.tasks.parameters import LogParams, SimulationParams

Scene = SumoScene | LogScene

_COUNTS = {"source", "towns", "test_towns", "routes", "test_routes", "egos_per_run"}


@dataclass(frozen=True)
class ScenePart:
    """A part of a scene that is recorded by itself.

    Attributes:
        name: what is added to the scene's label; empty if the scene is of one piece.
        params: parameters of the stage `scene`.
        splits: "train", "test" or both: what its frames are for.
    """

    name: str
    params: LogParams | SimulationParams
    splits: tuple[str, ...]


def scene_parts(scene: Scene) -> list[ScenePart]:
    """The parts of a scene, those with training frames first."""
    if isinstance(scene, LogScene):
        train, test = scene.frame_counts()
        splits = tuple(s for s, count in (("train", train), ("test", test)) if count)
        return [ScenePart("", LogParams(scene, scene.digest()), splits)]
    # Left out is what only says how many runs there are: more towns leave these as they are.
    settings = SumoScene.model_validate(scene.model_dump(mode="json", exclude=_COUNTS))
    return [
        ScenePart(
            run.name,
            SimulationParams(settings, run, _map_digest(run.town)),
            (run.part,) if scene.split == "route" else ("train", "test"),
        )
        for run in scene.town_runs()
        if run.routes
    ]


def scene_name(scene: Scene) -> str:
    """What a scene is called where nothing else tells it from others."""
    return scene.name if isinstance(scene, LogScene) else f"sumo-{scene.seed}"


def _map_digest(town: str) -> str | None:
    """Hash of the map's content, None for a generated town."""
    if town == GENERATED:
        return None
    return hashlib.sha256(find_map(town).read_bytes()).hexdigest()

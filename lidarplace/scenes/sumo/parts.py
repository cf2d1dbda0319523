"""The parts of a scene of simulated traffic: one a simulation, so that towns run in parallel."""

import hashlib
from dataclasses import dataclass

from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.parts import ScenePart
from lidarplace.scenes.sumo.maps import find_map
from lidarplace.scenes.sumo.record import record_town
from lidarplace.scenes.sumo.settings import GENERATED, SumoScene, TownRun

_COUNTS = {"source", "towns", "test_towns", "test_seed", "routes", "test_routes", "egos_per_run"}


@dataclass(frozen=True)
class TownRecording:
    """One simulation of traffic.

    Attributes:
        scene: with the default of what says which runs there are: `run` has its own.
        map: SHA-256 of the town's map; None for a generated town.
    """

    scene: SumoScene
    run: TownRun
    map: str | None

    def record(self) -> BoxLog:
        """Simulate it. Raises as `record_town` does."""
        return record_town(self.scene, self.run)


def town_parts(scene: SumoScene) -> list[ScenePart]:
    """The simulations of a scene that have routes, training first.

    Raises ValueError: a map is nowhere to be found.
    """
    # Left out is what only says which runs there are: more towns leave these as they are.
    settings = SumoScene.model_validate(scene.model_dump(mode="json", exclude=_COUNTS))
    return [
        ScenePart(
            run.name,
            TownRecording(settings, run, _map_digest(run.town)),
            (run.part,) if scene.split == "route" else ("train", "test"),
        )
        for run in scene.town_runs()
        if run.routes
    ]


def _map_digest(town: str) -> str | None:
    """Hash of the map's content, None for a generated town."""
    if town == GENERATED:
        return None
    return hashlib.sha256(find_map(town).read_bytes()).hexdigest()

"""Traffic for who has no log at hand."""

from pathlib import Path
from typing import Any

from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.sumo.record import record
from lidarplace.scenes.sumo.settings import SumoScene


def simulated_scene() -> SumoScene:
    """A generated town as three cars see it, each for half a minute: 180 frames, 60 to test."""
    return SumoScene(routes=2, test_routes=1, frames_per_route=60, frame_stride=10)


def simulated_traffic() -> BoxLog:
    """The box log of `simulated_scene`.

    Raises:
        ModuleNotFoundError: SUMO is not installed.
    """
    return record(simulated_scene())


def scene_of(log: Path | None) -> dict[str, Any]:
    """The traffic as a configuration of a sweep has it: of a log's folder, or else simulated."""
    if log is not None:
        return {"source": "log", "folder": str(log.absolute())}
    scene = simulated_scene()
    return {"source": scene.source, **scene.model_dump(mode="json", exclude_unset=True)}

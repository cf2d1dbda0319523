"""Traffic for who has no log at hand."""

from __future__ import annotations

from lidarplace.box_log import BoxLog
from lidarplace.scenes.sumo.record import record
from lidarplace.scenes.sumo.settings import SumoScene


def simulated_traffic() -> BoxLog:
    """A generated town as three cars see it, each for half a minute: 180 frames.

    Raises:
        ModuleNotFoundError: SUMO is not installed.
    """
    return record(SumoScene(routes=2, test_routes=1, frames_per_route=60, frame_stride=10))

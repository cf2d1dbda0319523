"""Where do the LiDARs go on a vehicle? Box logs, occupancy, coverage and surrogates."""

import lidarplace.start  # noqa: F401 - before all that takes a second to import
from lidarplace.occupancy.grid import OccupancyGrid
from lidarplace.placement import PAPER_PLACEMENTS, Mount, Placement
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.roi import Roi
from lidarplace.sensor import Lidar
from lidarplace.surrogates.compare import compare
from lidarplace.surrogates.evaluate import (
    evaluate,
    evaluate_classes,
    evaluate_many,
    expected_ig_by_q,
)
from lidarplace.surrogates.result import Surrogates, sum_over_classes
from lidarplace.weather import Weather

__all__ = [
    "PAPER_PLACEMENTS",
    "ExpectedRecall",
    "Lidar",
    "Mount",
    "OccupancyGrid",
    "Placement",
    "Roi",
    "Surrogates",
    "Weather",
    "compare",
    "evaluate",
    "evaluate_classes",
    "evaluate_many",
    "expected_ig_by_q",
    "sum_over_classes",
]


def __dir__() -> list[str]:
    """The public names: modules are for those who know theirs."""
    return sorted(__all__)

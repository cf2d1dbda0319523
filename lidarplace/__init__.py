"""Placement of LiDARs on a vehicle: box logs, occupancy, coverage and surrogates."""

from __future__ import annotations

from typing import Any

from lidarplace.base.plotting import draw_with
from lidarplace.base.roi import Roi
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.evaluate import (
    compare,
    evaluate,
    evaluate_classes,
    evaluate_many,
    expected_ig_of_rays,
)
from lidarplace.pog.surrogates.result import Surrogates, sum_over_classes
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Mount, Placement
from lidarplace.rigs.weather import Weather

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
    "expected_ig_of_rays",
    "plot",
    "sum_over_classes",
]


def plot(thing: Any) -> Any:
    """Return the figure of a thing (`plotly.graph_objects.Figure`): what `thing.plot()` is."""
    from lidarplace.viewing.figures import figure

    return figure(thing)


draw_with(plot)


def __dir__() -> list[str]:
    """Return the public names: modules are for those who know theirs."""
    return sorted(__all__)

"""What a rig hits of the objects of a log, as detectors met them."""

from __future__ import annotations

from collections.abc import Callable

import pandas as pd

from lidarplace.base.roi import Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLASSES
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.recall.surface_cells import SurfaceCells
from lidarplace.rigs.placement import Placement

ROI = Roi((0, 40), (-20, 20), (0, 4), resolution=0.1)
"""Of the detectors."""
CELL_M = 0.1
FRAMES = 280
"""As for the surrogates of objects."""


def seen_objects(placement: Placement, log: BoxLog) -> tuple[CountedObjects, SurfaceCells]:
    """The objects that count, and what one rig hits of them."""
    objects = CountedObjects.from_log(log, ROI, CLASSES, CELL_M, frames=FRAMES, seed=1)
    return objects, objects.seen_by([placement])[0]


def by_class(table: pd.DataFrame, measure: Callable[[pd.DataFrame], float]) -> dict[str, float]:
    """A measure of the objects of each class, column `class`, and of "all"."""
    found = {str(name): measure(own) for name, own in table.groupby("class")}
    return found | {"all": measure(table)}

"""The numbers of a rig, fast enough to follow a hand: coarse while it moves, exact at rest."""

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from statistics import fmean

import numpy as np
from cachetools import LRUCache

from lidarplace.base.roi import Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.evaluate import evaluate_classes
from lidarplace.recall.counted_objects import CountedObjects, MountedLidar
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.recall.surface_cells import SurfaceCells
from lidarplace.rigs.placement import Placement

MOUNTS = 256
"""Number of mounts whose cells are kept; those of a hundred frames take a few megabytes."""


class SeenCells:
    """Cells of the surfaces of `objects`, kept by LiDAR and what of its rig is in its way."""

    def __init__(self, objects: CountedObjects) -> None:
        self.objects = objects
        self._kept: LRUCache[MountedLidar, SurfaceCells] = LRUCache(MOUNTS)
        self._keeping = threading.Lock()

    def of(self, placement: Placement | None) -> SurfaceCells:
        """Return the cells that a rig hits, None being no LiDAR."""
        if placement is None:
            return SurfaceCells.none(len(self.objects.table))
        lidars = self.objects.in_rig(placement)
        with self._keeping:
            cells = {lidar: self._kept[lidar] for lidar in lidars if lidar in self._kept}
        missing = [lidar for lidar in lidars if lidar not in cells]
        cast = dict(zip(missing, self.objects.cells_of(missing), strict=True))
        with self._keeping:
            self._kept.update(cast)
        cells |= cast
        return reduce(SurfaceCells.and_, (cells[lidar] for lidar in lidars))


RECALL_FRAMES = 20
"""Number of frames of `expected_recall`: those of a second differ little."""
MOVING_RAYS = 40_000
"""Rays of a LiDAR that are cast in each frame while it moves."""


@dataclass(frozen=True)
class Numbers:
    """Numbers of a rig by class: nats, and the mean probability that an object is found.

    NaN of a class without objects. All rays were cast for this if `exact`; nats are always
    exact."""

    s_mig: Mapping[str, float]
    covered_entropy: Mapping[str, float]
    expected_recall: Mapping[str, float]
    exact: bool

    @property
    def mean_recall(self) -> float:
        """Mean of `expected_recall` over the classes with objects; NaN without any."""
        values = [value for value in self.expected_recall.values() if not math.isnan(value)]
        return fmean(values) if values else math.nan


class Meter:
    """Measures rigs on the frames of a log, on a sedan if `vehicle` is None."""

    def __init__(
        self, log: BoxLog, roi: Roi, classes: Sequence[str], vehicle: Vehicle | None = None
    ) -> None:
        self.grids = OccupancyGrid.by_class(log.boxes, roi, classes, len(log.frames))
        frames = RECALL_FRAMES
        self.recall = ExpectedRecall.from_log(log, roi, classes, frames=frames, vehicle=vehicle)
        self.h_pog = {name: grid.h_pog for name, grid in self.grids.items()}
        self.seen = SeenCells(self.recall.objects)
        of_class = self.recall.objects.table["class"].to_numpy()
        self._rows = {name: np.flatnonzero(of_class == name) for name in classes}

    def measure(self, placement: Placement | None, exact: bool = True) -> Numbers:
        """Measure a rig, None being no LiDAR, with all rays if `exact`, else MOVING_RAYS."""
        information = dict.fromkeys(self.grids, 0.0)
        if placement is not None:
            results = evaluate_classes(self.grids, placement)
            information = {name: result.covered_entropy for name, result in results.items()}
        rays = placement if exact or placement is None else thinned(placement, MOVING_RAYS)
        probabilities = self.recall.probabilities(self.seen.of(rays))
        recall = {
            name: float(probabilities[rows].mean()) if len(rows) else np.nan
            for name, rows in self._rows.items()
        }
        s_mig = {name: 0 - value for name, value in information.items()}
        return Numbers(s_mig, information, recall, exact)


def thinned(placement: Placement, rays: int) -> Placement:
    """Return the rig with every n-th azimuth step, so that no LiDAR has more rays than this."""
    return placement.each_lidar(lambda lidar: lidar.thinned(min(1.0, rays / lidar.rays)))

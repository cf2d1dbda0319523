"""One frame of a log as a rig sees it: its cloud, and what is seen of every object."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.collect import SimulatedClouds, crop_for
from lidarplace.logs.box_log import BoxLog
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.rigs.placement import Placement
from lidarplace.studio.numbers import SeenCells, thinned
from lidarplace.viewing.frame import Frame, read_frame

MOVING_POINTS = 60_000
"""Rays of all LiDARs together that are cast for a picture while something moves: a message of half
a megabyte."""
RESTING_POINTS = 300_000
"""The same at rest."""


class SimulatedCloud(NamedTuple):
    """The points of a rig in one frame.

    Attributes:
        points: x, y, z in metres, ego frame, shape (n, 3), float32.
        lidar: which working LiDAR of the placement each comes from, shape (n,), int64.
    """

    points: NDArray[np.float32]
    lidar: NDArray[np.int64]


class FrameView:
    """A frame of a log.

    Args:
        log, number: the frame.
        roi: what is shown of it.
        classes: of objects that count.
        vehicle: carries the LiDARs; None: a sedan.

    Raises:
        ValueError: there is no such frame, or a box is bad.
    """

    def __init__(
        self,
        log: BoxLog,
        number: int,
        roi: Roi,
        classes: Sequence[str],
        vehicle: Vehicle | None = None,
    ) -> None:
        self.crop: Crop = (roi.x[0], roi.y[0], roi.z[0], roi.x[1], roi.y[1], roi.z[1])
        self.number = number
        self.frame: Frame = read_frame(log, number, self.crop)
        self.recall = ExpectedRecall.from_log(self.frame.log, roi, classes, vehicle=vehicle)
        self._roi, self._vehicle = roi, vehicle
        self._seen = SeenCells(self.recall.objects)

    def objects(self, placement: Placement | None) -> pd.DataFrame:
        """The objects that count, and what the rig sees of each, None being no LiDAR.

        Columns of the box log, and `points`, `cells` of the surface and `probability` that it is
        found; `visibility` is the share that an ideal sensor above the vehicle would see. All rays
        are cast.
        """
        seen = self._seen.of(placement)
        return self.recall.objects.table.assign(
            points=seen.points, cells=seen.counts(), probability=self.recall.probabilities(seen)
        )

    def cloud(self, placement: Placement | None, most: int) -> SimulatedCloud:
        """The points in the ROI and on the ground under it, None being no LiDAR.

        Args:
            most: rays of all LiDARs together; of more every n-th azimuth step is cast.
        """
        if placement is None:
            return SimulatedCloud(np.empty((0, 3), np.float32), np.empty(0, np.int64))
        rig = thinned(placement, max(1, most // len(placement.mounts)))
        crop = crop_for(self._roi.x, self._roi.y, self._roi.z, rig)
        clouds = SimulatedClouds(self.frame.log, [self.number], rig, crop, vehicle=self._vehicle)
        points, counts = clouds.returns(0)
        return SimulatedCloud(points[:, :3].copy(), np.repeat(np.arange(len(counts)), counts))

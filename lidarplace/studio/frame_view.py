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

# Rays of all LiDARs together for a picture; 60,000 are a message of half a megabyte.
MOVING_POINTS, RESTING_POINTS = 60_000, 300_000


class SimulatedCloud(NamedTuple):
    """Points of a rig in one frame, (n, 3), metres, ego frame, and the working LiDAR of each."""

    points: NDArray[np.float32]
    lidar: NDArray[np.int64]


class FrameView:
    """The ROI in frame `number` of a log, on a sedan if `vehicle` is None.

    Raises ValueError: there is no such frame, or a box is bad."""

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
        """Return the objects that count, with what the rig has of them, None being no LiDAR.

        `points` and `cells` of the surface that all rays of the rig hit, and the `probability` that
        each is found."""
        seen = self._seen.of(placement)
        return self.recall.objects.table.assign(
            points=seen.points, cells=seen.counts(), probability=self.recall.probabilities(seen)
        )

    def cloud(self, placement: Placement | None, most: int) -> SimulatedCloud:
        """Return the points in the ROI and on the ground under it, None being no LiDAR.

        Of more than `most` rays of all LiDARs together every n-th azimuth step is cast."""
        if placement is None:
            return SimulatedCloud(np.empty((0, 3), np.float32), np.empty(0, np.int64))
        rig = thinned(placement.at_once(), max(1, most // len(placement.mounts)))
        crop = crop_for(self._roi.x, self._roi.y, self._roi.z, rig)
        clouds = SimulatedClouds(self.frame.log, [self.number], rig, crop, vehicle=self._vehicle)
        points, counts = clouds.returns(0)
        return SimulatedCloud(points[:, :3].copy(), np.repeat(np.arange(len(counts)), counts))

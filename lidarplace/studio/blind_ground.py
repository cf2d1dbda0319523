"""Where on the ground around the vehicle somebody can stand of whom too little is seen."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.check_requirements import RequirementResult
from lidarplace.rigs.placement import Placement

EDGE_M = 0.25
"""Of a cell of the ground."""
REACH_M = 6.0
"""From the vehicle's sides."""
LOWEST_M = 0.25
"""Below it nobody is looked for: the ground itself returns light."""
HEIGHTS_M = {"a child": 1.0, "an adult": 1.5}
"""Up to which somebody is looked for: below the top of the head, in whole voxels."""
COUNTED_M = {f"sensors on {who}": height for who, height in HEIGHTS_M.items()}


@dataclass(frozen=True)
class BlindGround:
    """Cells of the ground by their middles, x, y in metres, shape (cells, 2), and how many LiDARs
    see each; without `sensors` those with too little. `share` is of all cells that are asked for.
    """

    middles: NDArray[np.float64]
    share: float
    edge: float = EDGE_M
    sensors: NDArray[np.int64] | None = None


def blind_ground(placement: Placement | None, vehicle: Vehicle, height: float) -> BlindGround:
    """The cells around the vehicle over which no voxel below `height` is seen past the body.

    The share is of all cells outside of the body. `height` is in metres, a multiple of EDGE_M above
    LOWEST_M. Without a LiDAR, all is blind."""
    middles, sensors = _counted(placement, vehicle, height)
    return BlindGround(middles[sensors == 0], float((sensors == 0).mean()))


def counted_ground(placement: Placement | None, vehicle: Vehicle, height: float) -> BlindGround:
    """All cells around the vehicle with the number of LiDARs that see a voxel below `height` there.
    The share is of those with less than two. Arguments as of `blind_ground`."""
    middles, sensors = _counted(placement, vehicle, height)
    return BlindGround(middles, float((sensors < 2).mean()), sensors=sensors)


def _counted(
    placement: Placement | None, vehicle: Vehicle, height: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Middles of the cells, and the sensors over each."""
    extents = vehicle.body.extents
    low = extents[:, 0, :2].min(axis=0, initial=0.0) - REACH_M
    high = extents[:, 1, :2].max(axis=0, initial=0.0) + REACH_M
    (x0, y0), (x1, y1) = np.floor(low / EDGE_M) * EDGE_M, np.ceil(high / EDGE_M) * EDGE_M
    roi = Roi((x0, x1), (y0, y1), (LOWEST_M, height), EDGE_M)
    sensors, there = np.zeros(roi.shape[:2], np.int64), np.ones(roi.shape[:2], bool)
    if placement is not None:
        each = [(number,) for number in range(len(placement.mounts))]
        seen, outside = seen_in_columns(placement, vehicle, roi, each)
        sensors, there = (seen > 0).sum(axis=0), outside > 0
    rows, columns = np.nonzero(there)
    middles = np.stack([roi.centres(0)[rows], roi.centres(1)[columns]], axis=1)
    return middles, sensors[there]


def failing_ground(outcome: RequirementResult) -> BlindGround:
    """The positions of a requirement that have too little in any of its cases."""
    fails = outcome.least_of < outcome.requirement.least
    points = outcome.positions.points[fails]
    return BlindGround(points, float(fails.mean()), outcome.requirement.step)

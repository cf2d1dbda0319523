"""Ground around the vehicle: where too little of a person is seen, and what is found where."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.near_field import seen_in_columns
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.check_requirements import RequirementResult
from lidarplace.requirements.recall_ground import HARDEST, STEP_M, recall_ground
from lidarplace.rigs.placement import Placement

EDGE_M = 0.25
"""Edge of a cell of the ground, metres."""
REACH_M = 6.0
"""Distance from the vehicle's sides, metres."""
SITE_REACH_M = 20.0
"""Distance from the origin of a site, metres."""
LOWEST_M = 0.25
"""Height below which nobody is looked for, metres: the ground itself returns light."""
_PERSONS_M = {"a child": 1.0, "an adult": 1.5}
HEIGHTS_M = {f"blind for {person}": height for person, height in _PERSONS_M.items()}
"""Heights up to which a person is looked for, metres: below the head's top, in whole voxels."""
COUNTED_M = {f"sensors on {person}": height for person, height in _PERSONS_M.items()}
FINDING = {f"recall of a {name}": name for name in HARDEST}
"""Classes whose expected recall colours the ground."""


@dataclass(frozen=True)
class BlindGround:
    """Cells of the ground by their middles, x, y in metres, shape (cells, 2).

    `sensors` is how many LiDARs see each, `recall` how likely an object is found there; without
    either the cells are those with too little. `share` is of all cells, or the mean of recall."""

    middles: NDArray[np.float64]
    share: float
    edge: float = EDGE_M
    sensors: NDArray[np.int64] | None = None
    recall: NDArray[np.float64] | None = None


def blind_ground(placement: Placement | None, vehicle: Vehicle, height: float) -> BlindGround:
    """Return the cells around the vehicle over which no voxel below `height` is seen past the body.

    The share is of all cells outside of the body. `height` is in metres, a multiple of EDGE_M above
    LOWEST_M. Without a LiDAR, all is blind."""
    middles, sensors = _counted(placement, vehicle, height)
    return BlindGround(middles[sensors == 0], float((sensors == 0).mean()))


def counted_ground(placement: Placement | None, vehicle: Vehicle, height: float) -> BlindGround:
    """Return all cells around the vehicle with the number of LiDARs that see a voxel there.

    The share is of those with less than two. Arguments as of `blind_ground`."""
    middles, sensors = _counted(placement, vehicle, height)
    return BlindGround(middles, float((sensors < 2).mean()), sensors=sensors)


def found_ground(
    placement: Placement | None, vehicle: Vehicle, object_class: str
) -> BlindGround | None:
    """Return all cells with the expected recall of a class; None without a LiDAR."""
    if placement is None:
        return None
    ground = recall_ground(placement, vehicle, object_class)
    rows, columns = np.nonzero(~np.isnan(ground.built))
    middles, recall = np.stack([ground.x[rows], ground.y[columns]], 1), ground.built[rows, columns]
    return BlindGround(middles, float(recall.mean()), STEP_M, recall=recall)


def _counted(
    placement: Placement | None, vehicle: Vehicle, height: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return middles of the cells, and the sensors over each."""
    extents = vehicle.body.extents
    reach = REACH_M if len(extents) else SITE_REACH_M
    low = extents[:, 0, :2].min(axis=0, initial=0.0) - reach
    high = extents[:, 1, :2].max(axis=0, initial=0.0) + reach
    (x0, y0), (x1, y1) = np.floor(low / EDGE_M) * EDGE_M, np.ceil(high / EDGE_M) * EDGE_M
    roi = Roi((x0, x1), (y0, y1), (LOWEST_M, height), EDGE_M)
    sensors, outside_body = np.zeros(roi.shape[:2], np.int64), np.ones(roi.shape[:2], bool)
    if placement is not None:
        each = [(number,) for number in range(len(placement.mounts))]
        seen, outside = seen_in_columns(placement, vehicle, roi, each)
        sensors, outside_body = (seen > 0).sum(axis=0), outside > 0
    rows, columns = np.nonzero(outside_body)
    middles = np.stack([roi.centres(0)[rows], roi.centres(1)[columns]], axis=1)
    return middles, sensors[outside_body]


def failing_ground(result: RequirementResult) -> BlindGround:
    """Return the positions of a requirement that have too little in any of its cases."""
    fails = result.least_of < result.requirement.least
    points = result.positions.points[fails]
    return BlindGround(points, float(fails.mean()), result.requirement.step)

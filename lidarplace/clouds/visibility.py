"""The ground truth of a fair experiment: what an ideal sensor sees, whatever the placement."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.roi import Interval
from lidarplace.clouds.raycast import cast, visible_share
from lidarplace.clouds.shapes import Parts
from lidarplace.clouds.static_world import WorldAround, cast_in_world
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.truncation import truncation
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, count_columns
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount

VIEWPOINT = (0.0, 0.0, 2.4)
"""Above the middle of the vehicle, as high as the lowest LiDAR of the paper's *Center*."""

GRID = (32, 24)
"""Rays over the azimuths and elevations of an object, of which about half meet it: shares come in
steps below half a percent."""

_DENSE = Lidar(tuple(np.radians(np.arange(-40.0, 20.0, 0.25))), azimuth_steps=1440)

OCCLUDED = (0.8, 0.4)
"""Visible shares from which an object is fully visible (KITTI's `occluded` 0) or partly occluded
(1). Less is largely occluded (2), nothing is unknown (3). KITTI's annotators judged by eye; the
numbers are bounds of nuScenes's levels of visibility."""


def visibility(log: BoxLog, seed: int = 0) -> NDArray[np.float64]:
    """Share of each object that an ideal, dense sensor at `VIEWPOINT` sees, in [0, 1].

    Of the rays that meet the object when it is alone, the share that still meets it first among
    all objects and buildings of its frame; times the share of those of a dense LiDAR that the
    static world of the log does not stop before. Neither flat ground nor own body hides anything,
    so the share does not depend on a placement. 0 means hidden.

    Args:
        log: objects, frames and buildings.
        seed: of the shapes; the one the clouds are collected with.

    Returns:
        One share a row of `log.boxes`, shape (rows,), float64.

    Raises:
        ValueError: a column is missing, or a box or pose is bad.
    """
    surroundings = Surroundings(log, seed)
    geometry = log.boxes[list(GEOMETRY)].to_numpy(np.float64)
    farthest = np.hypot(geometry[:, 0], geometry[:, 1]) + np.hypot(geometry[:, 3], geometry[:, 4])
    share = np.empty(len(geometry))
    for frame in log.boxes["frame"].unique().tolist():
        rows = surroundings.rows(frame)
        parts = surroundings.parts(frame, reach=farthest[rows].max())
        share[rows] = visible_share(VIEWPOINT, parts, len(rows), GRID)
        if (world := surroundings.world(frame)) is not None:
            share[rows] *= _open_share(parts, world, len(rows))
    return share


def _open_share(parts: Parts, world: WorldAround, objects: int) -> NDArray[np.float64]:
    """Of the rays of a dense LiDAR that meet an object, the share that the world lets through."""
    mount = Mount(*VIEWPOINT)
    alone = cast(mount, _DENSE, parts, level=False)
    past = cast_in_world(mount, _DENSE, parts, world, only_objects=True)
    before, after = (
        np.bincount(hits.target[hits.target >= 0], minlength=objects) for hits in (alone, past)
    )
    return np.divide(after, before, out=np.ones(objects), where=before > 0)


def occluded(share: NDArray[np.float64]) -> NDArray[np.int64]:
    """KITTI's levels 0 to 3 of visible shares; see `OCCLUDED`."""
    full, partly = OCCLUDED
    return np.select([share >= full, share >= partly, share > 0], [0, 1, 2], 3)


def ground_truth(log: BoxLog, x: Interval, y: Interval, z: Interval, seed: int = 0) -> pd.DataFrame:
    """The objects that count: centre in the ROI x, y, z, faces included, and visible.

    Rows of `log.boxes` without counts of real points and with three columns more: `visibility`, the
    share seen; `occluded`, KITTI's level of it; `truncated`, the share of the footprint outside the
    ROI, where KITTI's is that outside the image. Hidden objects and those outside still hide
    others. The same for every placement.
    """
    inside = np.ones(len(log.boxes), bool)
    for axis, (low, high) in zip("xyz", (x, y, z), strict=True):
        inside &= log.boxes[axis].between(low, high).to_numpy()
    share = visibility(log, seed)
    # Real points are of the whole recorded rig, and would be taken for those of a placement.
    table = log.boxes.drop(columns=count_columns(log.boxes)).assign(
        visibility=share,
        occluded=occluded(share),
        truncated=truncation(log.boxes[list(GEOMETRY)].to_numpy(np.float64), x, y),
    )
    return table[inside & (share > 0)]

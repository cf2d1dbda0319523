"""The ground truth of a fair experiment: what an ideal sensor sees, whatever the placement."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.boxes import GEOMETRY, check_boxes, frame_ids
from lidarplace.lidar.raycast import visible_share
from lidarplace.roi import Interval

VIEWPOINT = (0.0, 0.0, 2.4)
"""Above the middle of the vehicle, as high as the lowest LiDAR of the paper's *Center*."""

GRID = (32, 24)
"""Rays over the azimuths and elevations of a box: shares come in steps below half a percent."""


def visibility(boxes: pd.DataFrame) -> NDArray[np.float64]:
    """Share of each box that an ideal, dense sensor at `VIEWPOINT` sees, shape (rows,), in [0, 1].

    Of the rays that meet the box when it is alone, the share that still meets it first among all
    boxes of its frame. Neither ground nor own body hides anything, so the share does not depend
    on a placement. 0 means hidden.

    Raises:
        ValueError: a column is missing or a box is bad.
    """
    check_boxes(boxes)
    frame = frame_ids(boxes)
    order = np.argsort(frame, kind="stable")
    geometry = boxes[list(GEOMETRY)].to_numpy(np.float64)[order]
    share = np.empty(len(boxes))
    bounds = np.flatnonzero(np.diff(frame[order], prepend=-1, append=-1))
    for first, last in itertools.pairwise(bounds):
        share[order[first:last]] = visible_share(VIEWPOINT, geometry[first:last], GRID)
    return share


def ground_truth(boxes: pd.DataFrame, x: Interval, y: Interval, z: Interval) -> pd.DataFrame:
    """The objects that count: centre in the ROI x, y, z, faces included, and visible.

    Rows of `boxes` with a column `visibility` added; hidden objects and those outside still hide
    others. The same for every placement.
    """
    inside = np.ones(len(boxes), bool)
    for axis, (low, high) in zip("xyz", (x, y, z), strict=True):
        inside &= boxes[axis].between(low, high).to_numpy()
    table = boxes.assign(visibility=visibility(boxes))
    return table[inside & (table["visibility"] > 0).to_numpy()]

"""Which objects can be seen from the vehicle at all: the ground truth of every placement."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.boxes import GEOMETRY, check_boxes
from lidarplace.lidar.raycast import visible_shares
from lidarplace.roi import Interval

VIEWPOINT = (0.0, 0.0, 2.4)
"""Where the ideal dense sensor sits: on the roof, ego frame, metres; the same for all placements."""

RAYS = (24, 12)
"""Rays over the width and over the height of an object, however far it is."""


def visibility(boxes: pd.DataFrame, wanted: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
    """Share of each box that an ideal dense sensor on the roof sees; other boxes hide it.

    Args:
        boxes: rows of a box log; all boxes of a frame count as obstacles.
        wanted: rows to look at, all if None.

    Returns:
        Shares in [0, 1], shape (rows,); 0 for boxes that are hidden or not wanted.
    """
    check_boxes(boxes)
    if wanted is None:
        wanted = np.ones(len(boxes), np.bool_)
    shares = np.zeros(len(boxes))
    geometry = boxes[list(GEOMETRY)].to_numpy(np.float64)
    viewpoint = np.array(VIEWPOINT)
    for rows in boxes.groupby("frame", sort=False).indices.values():
        if wanted[rows].any():
            shares[rows] = visible_shares(viewpoint, geometry[rows], wanted[rows], *RAYS)
    return shares


def ground_truth(boxes: pd.DataFrame, x: Interval, y: Interval, z: Interval) -> pd.DataFrame:
    """Rows of a box log that count: centre in the ROI and visible, however little.

    Returns:
        The rows, numbered anew, with a column `visibility` in (0, 1].
    """
    inside = np.ones(len(boxes), np.bool_)
    for axis, (low, high) in zip("xyz", (x, y, z), strict=True):
        inside &= boxes[axis].between(low, high).to_numpy()
    counted = boxes.assign(visibility=visibility(boxes, inside))
    return counted[counted["visibility"] > 0].reset_index(drop=True)

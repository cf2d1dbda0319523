"""Boxes above or below the ground z = 0: their number, and setting them on it.

Rays end on the ground z = 0. Real roads are uneven, so at a distance boxes are below or above."""

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidarplace.logs.box_log import BoxLog

OFF_M = 0.3  # an underside farther from z = 0 is off the ground
OFF = ("buried", "below", "above")  # columns of `off_ground`
NEAR_M = 15.0
NEIGHBOURS = 5
"""The ground at a box is the median underside of at most so many boxes so near, itself included."""


def undersides(boxes: pd.DataFrame) -> NDArray[np.float64]:
    """Return the height of the underside of each box above z = 0, metres, shape (boxes,)."""
    return np.asarray(boxes["z"] - boxes["height"] / 2, np.float64)


def off_ground(log: BoxLog) -> pd.DataFrame:
    """Count the boxes off the ground by split.

    These are boxes with the centre under the ground, and with the underside more than `OFF_M` below
    or above it. Returns columns split, boxes, and those of `OFF`."""
    under = undersides(log.boxes)
    off = dict(zip(OFF, (log.boxes["z"] < 0, under < -OFF_M, under > OFF_M), strict=True))
    split = log.boxes["frame"].map(log.frames.set_index("frame")["split"])
    table = pd.DataFrame({"split": split, "boxes": 1, **off})
    return table.groupby("split", as_index=False).sum()


def levelled(log: BoxLog) -> tuple[BoxLog, NDArray[np.float64]]:
    """Set boxes on the ground by the log's own undersides, frame by frame.

    Returns the log, and how far each box was moved upwards, metres, shape (boxes,). The height of
    the road at a box is the median underside of its neighbours, see `NEIGHBOURS`, so a box that is
    higher or lower than those around it stays so; a box alone is set on the ground."""
    boxes = log.boxes.reset_index(drop=True)
    under = undersides(boxes)
    place = boxes[["x", "y"]].to_numpy(np.float64)
    road = np.zeros(len(boxes))
    for rows in boxes.groupby("frame").indices.values():
        tree = cKDTree(place[rows])
        _, near = tree.query(place[rows], min(NEIGHBOURS, len(rows)), distance_upper_bound=NEAR_M)
        # Where there are fewer neighbours, their number stands for each that is missing.
        heights = np.append(under[rows], np.nan)[near.reshape(len(rows), -1)]
        road[rows] = np.nanmedian(heights, axis=1)
    return replace(log, boxes=boxes.assign(z=boxes["z"] - road)), -road

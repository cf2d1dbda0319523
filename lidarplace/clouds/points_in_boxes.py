"""Count the points inside rotated boxes."""

import math

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.base.rings import bounds_of, ring_of
from lidarplace.clouds.clouds import Clouds
from lidarplace.logs.boxes import GEOMETRY

MARGIN_M = 0.05
"""Points on the skin of an object err by noise and rounding: its box is grown by so much to all
sides when its points are counted for a table."""


def count_points(points: ArrayLike, boxes: ArrayLike) -> NDArray[np.int64]:
    """Return the number of points (N, 3 or more) in each of `boxes` (M, 7), shape (M,).

    Both are in one frame, metres and radians. A point on the surface is inside."""
    of_none, geometry = np.empty(0, np.int64), np.require(boxes, np.float64, ["C", "W"])
    return _count(np.ascontiguousarray(points), geometry, 0.0, of_none)


def count_points_per_object(boxes: pd.DataFrame, clouds: Clouds) -> pd.DataFrame:
    """Count the points within `MARGIN_M` of the box of every object.

    Columns are frame, object_id, points; rows are in the order of `boxes`.

    `boxes` have `frame`, `object_id` and the columns of `GEOMETRY`; rows of frames that are not in
    `clouds`, ego frame, are left out."""
    frame = boxes["frame"].to_numpy(np.int64)
    order = np.argsort(frame, kind="stable")
    grown = boxes[list(GEOMETRY)].to_numpy(np.float64, copy=True)
    grown[:, 3:6] += 2 * MARGIN_M
    counts = np.full(len(boxes), -1, np.int64)
    for index, number in enumerate(clouds.frames.tolist()):
        rows = order[slice(*np.searchsorted(frame[order], [number, number + 1]))]
        if len(rows):
            counts[rows] = count_points(clouds[index], grown[rows])
    table = boxes[["frame", "object_id"]].assign(points=counts)
    return table[counts >= 0].reset_index(drop=True)


BY_DISTANCE = ("class", "from_m", "to_m", "objects", "mean", "median", "p10", "unseen")


def points_by_distance(objects: pd.DataFrame, points: pd.DataFrame) -> pd.DataFrame:
    """Return statistics of points per object of every class in every ring around the vehicle.

    `objects` are ground truth with frame, object_id, class, x, y; ego frame, metres; `points` of
    `count_points_per_object`. Objects of frames without points, and rings without objects, have no
    row. from_m and to_m bound the ring, objects is their number, mean, median and p10 are of the
    points on an object (a tenth have p10 or fewer), unseen is the share without a point."""
    counted = objects.merge(points, on=["frame", "object_id"])
    grouped = counted.assign(ring=ring_of(counted)).groupby(["class", "ring"], observed=True)[
        "points"
    ]
    table = grouped.agg(
        objects="size",
        mean="mean",
        median="median",
        p10=lambda values: values.quantile(0.1),
        unseen=lambda values: (values == 0).mean(),
    ).reset_index()
    bounds = [bounds_of(ring) for ring in table.pop("ring")]
    table["from_m"] = [low for low, _ in bounds]
    table["to_m"] = [high for _, high in bounds]
    return table[list(BY_DISTANCE)]


def box_of_points(
    points: NDArray[np.float32], boxes: NDArray[np.float64], margin: float = MARGIN_M
) -> NDArray[np.int64]:
    """Return the box (m, 7) that holds each of points (n, 3 or more), within `margin`.

    It is the last of several; -1: none. Shape (n,)."""
    owner = np.full(len(points), -1)
    # numba compiles again for read-only arrays and other orders.
    _count(np.ascontiguousarray(points), np.require(boxes, np.float64, ["C", "W"]), margin, owner)
    return owner


@njit(cache=True, nogil=True)
def _count(points, boxes, margin, owner) -> NDArray[np.int64]:
    """Count points in each box; `owner`, of all points or none, gets the last box that holds it."""
    counts = np.zeros(len(boxes), np.int64)
    for b in range(len(boxes)):
        x, y, z, length, width, height, yaw = boxes[b]
        cos, sin = math.cos(yaw), math.sin(yaw)
        for i in range(len(points)):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            if (
                abs(cos * dx + sin * dy) <= 0.5 * length + margin
                and abs(cos * dy - sin * dx) <= 0.5 * width + margin
                and abs(points[i, 2] - z) <= 0.5 * height + margin
            ):
                counts[b] += 1
                if len(owner):
                    owner[i] = b
    return counts

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
    """Number of `points` (N, 3 or more) in each of `boxes` (M, 7), shape (M,); same frame, metres
    and radians. A point on the surface is inside."""
    return _count(np.asarray(points), np.asarray(boxes, np.float64))


def count_points_per_object(boxes: pd.DataFrame, clouds: Clouds) -> pd.DataFrame:
    """Points of every object within `MARGIN_M` of its box: columns frame, object_id, points, in the
    order of `boxes`.

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
    """Points per object of every class in every ring around the vehicle.

    `objects` are ground truth with frame, object_id, class, x, y; ego frame, metres; `points` of
    `count_points_per_object`. Objects of frames without points, and rings without objects, have no
    row. Columns class, from_m, to_m (bounds of the ring), objects (their number), mean, median and
    p10 (of the points on an object; a tenth of the objects have p10 or fewer), unseen (share of the
    objects without a point, in [0, 1])."""
    found = objects.merge(points, on=["frame", "object_id"])
    grouped = found.assign(ring=ring_of(found)).groupby(["class", "ring"], observed=True)["points"]
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


def box_of_points(points: NDArray[np.float32], boxes: NDArray[np.float64]) -> NDArray[np.int64]:
    """Which of boxes (m, 7) holds each of points (n, 3 or more), within `MARGIN_M`, the last of
    several; -1: none. Shape (n,)."""
    owner = np.full(len(points), -1)
    for number, (*centre, length, width, height, yaw) in enumerate(boxes.tolist()):
        x, y, z = (points[:, :3] - np.array(centre)).T
        c, s = math.cos(yaw), math.sin(yaw)
        inside = np.abs(c * x + s * y) <= length / 2 + MARGIN_M
        inside &= np.abs(c * y - s * x) <= width / 2 + MARGIN_M
        owner[inside & (np.abs(z) <= height / 2 + MARGIN_M)] = number
    return owner


@njit(cache=True, nogil=True)
def _count(points, boxes) -> NDArray[np.int64]:
    counts = np.zeros(len(boxes), np.int64)
    for b in range(len(boxes)):
        x, y, z = boxes[b, 0], boxes[b, 1], boxes[b, 2]
        half_length, half_width, half_height = 0.5 * boxes[b, 3:6]
        cos, sin = math.cos(boxes[b, 6]), math.sin(boxes[b, 6])
        for i in range(len(points)):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            if (
                abs(cos * dx + sin * dy) <= half_length
                and abs(cos * dy - sin * dx) <= half_width
                and abs(points[i, 2] - z) <= half_height
            ):
                counts[b] += 1
    return counts

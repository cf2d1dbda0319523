"""The ground truth of a fair experiment: what an ideal sensor sees, whatever the placement."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.base.roi import Interval
from lidarplace.clouds.convex import enter_along, fill_corners, fill_planes, shorter_turn, window
from lidarplace.clouds.shapes import PANE, Parts
from lidarplace.clouds.static_world import WorldAround, first_met, worlds_of
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.truncation import truncation
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, POINTS, count_columns
from lidarplace.mounting.housing import turned

VIEWPOINT = (0.0, 0.0, 2.4)
"""Above the middle of the vehicle, as high as the lowest LiDAR of the paper's *Center*."""
GRID = (32, 24)
"""Rays over the azimuths and elevations of an object, of which about half meet it: shares come in
steps below half a percent."""
OCCLUDED = (0.8, 0.4)
"""Visible shares from which an object is fully visible (KITTI's `occluded` 0) or partly occluded
(1). Less is largely occluded (2), nothing is unknown (3). KITTI's annotators judged by eye; the
numbers are bounds of nuScenes's levels of visibility."""


def visibility(log: BoxLog, seed: int = 0) -> NDArray[np.float64]:
    """Share of each object that an ideal, dense sensor at `VIEWPOINT` sees, in [0, 1].

    Of the rays that meet the object when it is alone, the share that still meets it first among all
    objects and buildings of its frame and the static world of the log. Neither flat ground nor own
    body hides anything, so the share does not depend on a placement. 0 means hidden.

    One share a row of `log.boxes`, shape (rows,), float64. `seed`: of the shapes, as of the clouds.
    Raises ValueError if a column is missing, or a box or pose is bad."""
    surroundings = Surroundings(log, seed)
    geometry = log.boxes[list(GEOMETRY)].to_numpy(np.float64)
    farthest = np.hypot(geometry[:, 0], geometry[:, 1]) + np.hypot(geometry[:, 3], geometry[:, 4])
    share = np.empty(len(geometry))
    for frame in log.boxes["frame"].unique().tolist():
        rows = surroundings.rows(frame)
        parts = surroundings.parts(frame, reach=farthest[rows].max())
        world = surroundings.world(frame)
        share[rows] = visible_share(VIEWPOINT, parts, len(rows), GRID, world)
    return share


def visible_share(
    viewpoint: tuple[float, float, float],
    parts: Parts,
    objects: int,
    grid: tuple[int, int],
    world: WorldAround | None = None,
) -> NDArray[np.float64]:
    """Share of each object that an ideal sensor at `viewpoint`, ego frame, metres, sees past the
    others, float64, (objects,); `parts` are of one frame, owners of objects below `objects`.

    A grid of (azimuths, elevations) rays spans the angles of each object. As of `visibility`; 0 if
    no ray enters it: it is thinner than the grid, or all of it holds the viewpoint."""
    around = world or WorldAround(worlds_of({}), -1, np.eye(3), np.zeros(3))
    geometry = parts.geometry, parts.owner
    return _visible_share(np.array(viewpoint), *geometry, objects, *grid, *around)


@njit(cache=True, nogil=True, error_model="numpy")
def _visible_share(
    viewpoint, parts, owners, objects, width, height, worlds, scene, into, shift
) -> NDArray[np.float64]:
    number = len(parts)
    upright = np.eye(3)
    corners = np.empty((8, 3))
    planes = np.empty((number, 6, 5))
    facing = np.empty(number, np.int64)
    windows = np.empty((number, 7))
    for p in range(number):
        fill_corners(parts[p], corners)
        for n, bound in enumerate(window(corners, viewpoint, upright)):
            windows[p, n] = bound
        facing[p] = fill_planes(parts[p], viewpoint, upright, planes[p])

    eye, patch = into @ viewpoint + shift, np.empty(6)
    share = np.zeros(objects)
    own, other = np.empty((height, width)), np.empty(width)
    cosines, sines = np.empty(width), np.empty(width)
    elevations = np.empty((height, 2))
    last = 0
    for o in range(objects):
        first = last
        while first < number and owners[first] != o:
            first += 1
        last = first
        middle = windows[first, 0] if first < number else 0.0
        below = above = far = 0.0
        lowest, highest = np.inf, -np.inf
        while last < number and owners[last] == o:
            turn = shorter_turn(middle, windows[last, 0])
            below = max(below, windows[last, 1] - turn)
            above = max(above, windows[last, 2] + turn)
            lowest = min(lowest, windows[last, 3])
            highest = max(highest, windows[last, 4])
            far = max(far, windows[last, 6])
            last += 1
        below, above = min(below, math.pi), min(above, math.pi)
        for i in range(width):
            azimuth = middle - below + (below + above) * (i + 0.5) / width
            cosines[i], sines[i] = math.cos(azimuth), math.sin(azimuth)
        for j in range(height):
            elevation = lowest + (highest - lowest) * (j + 0.5) / height
            elevations[j, 0], elevations[j, 1] = math.cos(elevation), math.sin(elevation)
        own[:] = 0.0
        for p in range(first, last):
            if facing[p] == 0:
                continue
            for j in range(height):
                ce, se = elevations[j]
                enter_along(cosines, sines, planes[p], facing[p], ce, se, other)
                for i in range(width):
                    own[j, i] = max(own[j, i], other[i])
        alone = (own > 0.0).sum()
        if alone == 0:
            continue
        for p in range(number):
            turn = abs(shorter_turn(middle, windows[p, 0]))
            widths = max(below, above) + max(windows[p, 1], windows[p, 2])
            if (
                owners[p] == o
                or owners[p] == PANE - o
                or facing[p] == 0
                or windows[p, 5] > far
                or turn > widths + 1e-9
                or windows[p, 3] > highest
                or windows[p, 4] < lowest
            ):
                continue
            for j in range(height):
                ce, se = elevations[j]
                enter_along(cosines, sines, planes[p], facing[p], ce, se, other)
                for i in range(width):
                    own[j, i] = own[j, i] if own[j, i] >= other[i] else -1.0
        for ray in range(height * width if scene >= 0 else 0):
            j, i = ray // width, ray % width
            if own[j, i] > 0.0:
                ce, se = elevations[j]
                dx, dy, dz = turned(into, ce * cosines[i], ce * sines[i], se)
                most = 1.0 / own[j, i]
                place, way = (eye[0], eye[1], eye[2]), (dx, dy, dz)
                if first_met(*place, *way, most, ray, worlds, scene, patch)[0] < most:
                    own[j, i] = -1.0
        share[o] = (own > 0.0).sum() / alone
    return share


def occluded(share: NDArray[np.float64]) -> NDArray[np.int64]:
    """KITTI's levels 0 to 3 of visible shares; see `OCCLUDED`."""
    full, partly = OCCLUDED
    return np.select([share >= full, share >= partly, share > 0], [0, 1, 2], 3)


def ground_truth(
    log: BoxLog, x: Interval, y: Interval, z: Interval, seed: int = 0, by_points: bool = False
) -> pd.DataFrame:
    """The objects that count: centre in the ROI x, y, z, faces included, and visible.

    Rows of `log.boxes` without counts of real points and with three columns more: `visibility`, the
    share seen; `occluded`, KITTI's level of it; `truncated`, the share of the footprint outside the
    ROI, where KITTI's is that outside the image. Hidden objects and those outside still hide
    others. The same for every placement. `by_points`: those with a real point of the recorded rig
    count, in place of the visible ones."""
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
    counts = log.boxes[POINTS].to_numpy(np.float64) > 0 if by_points else share > 0
    return table[inside & counts]

"""The ground truth of a fair experiment: what an ideal sensor sees, whatever the placement."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.base.roi import Interval
from lidarplace.clouds.convex import (
    Window,
    enter_along,
    fill_corners,
    fill_planes,
    shorter_turn,
    window_of,
)
from lidarplace.clouds.raycast import Surfaces
from lidarplace.clouds.shapes import PANE, Parts
from lidarplace.clouds.static_world import first_met
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.truncation import truncation
from lidarplace.clouds.worlds import WorldAround, worlds_of
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, POINTS, VIEWPOINT_Z, count_columns
from lidarplace.mounting.housing import turned

VIEWPOINT = (0.0, 0.0, 2.4)
"""Above the middle of the vehicle, as high as the lowest LiDAR of the paper's *Center*. A site has
another height, see `VIEWPOINT_Z`."""
GRID = (32, 24)
"""Rays over the azimuths and elevations of an object, of which about half meet it: shares come in
steps below half a percent."""
OCCLUDED = (0.8, 0.4)
"""Visible shares from which an object is fully visible (KITTI's `occluded` 0) or partly occluded
(1). Less is largely occluded (2), nothing is unknown (3). KITTI's annotators judged by eye; the
numbers are bounds of nuScenes's levels of visibility."""


def visibility(log: BoxLog, seed: int = 0) -> NDArray[np.float64]:
    """Return the share of each object that an ideal, dense sensor at `VIEWPOINT` sees, in [0, 1].

    Of the rays that meet the object when it is alone, the share that still meets it first among all
    objects and buildings of its frame and the static world of the log. Neither flat ground nor own
    body hides anything, so the share does not depend on a placement. 0 means hidden.

    One share a row of `log.boxes`, shape (rows,), float64. `seed`: of the shapes, as of the clouds.
    Raises ValueError if a column is missing, or a box or pose is bad."""
    surroundings = Surroundings(log, seed)
    geometry = log.boxes[list(GEOMETRY)].to_numpy(np.float64)
    farthest = np.hypot(geometry[:, 0], geometry[:, 1]) + np.hypot(geometry[:, 3], geometry[:, 4])
    heights = log.frames.reindex(columns=[VIEWPOINT_Z]).fillna(VIEWPOINT[2])[VIEWPOINT_Z]
    eyes = dict(zip(log.frames["frame"], heights, strict=True))
    share = np.empty(len(geometry))
    for frame in log.boxes["frame"].unique().tolist():
        rows = surroundings.rows(frame)
        parts = surroundings.parts(frame, reach=farthest[rows].max())
        world = surroundings.world(frame)
        eye = (*VIEWPOINT[:2], eyes[frame])
        share[rows] = visible_share(eye, parts, len(rows), GRID, world)
    return share


def visible_share(
    viewpoint: tuple[float, float, float],
    parts: Parts,
    objects: int,
    grid: tuple[int, int],
    world: WorldAround | None = None,
) -> NDArray[np.float64]:
    """Return the share of each object that an ideal sensor sees past the others, (objects,).

    The sensor is at `viewpoint`, ego frame, metres; `parts` are of one frame, owners of objects
    below `objects`.

    A grid of (azimuths, elevations) rays spans the angles of each object. As of `visibility`; 0 if
    no ray enters it: it is thinner than the grid, or all of it holds the viewpoint."""
    around = world or WorldAround(worlds_of({}), -1, np.eye(3), np.zeros(3))
    surfaces = Surfaces(parts.geometry, parts.owner, parts.reflectivity)
    return _visible_share(np.array(viewpoint), surfaces, objects, (grid[1], grid[0]), around)


@njit(cache=True, nogil=True, error_model="numpy")
def _visible_share(viewpoint, surfaces, objects, grid, around) -> NDArray[np.float64]:
    """Return the visible share of each object.

    For each object: aim a grid of rays at its window; find where each enters the object when it is
    alone; take away those that meet another part first, then those that meet the world first."""
    parts = _seen_parts(viewpoint, surfaces)
    inverse = np.empty(grid)  # where rays enter the object, 1/m; not positive: they do not
    eye, memory = around.turn @ viewpoint + around.shift, np.empty(grid[1])
    share = np.zeros(objects)
    last = 0
    for number in range(objects):
        first = last
        while first < len(parts.facing) and surfaces.owner[first] != number:
            first += 1
        last = first
        while last < len(parts.facing) and surfaces.owner[last] == number:
            last += 1
        window = _joint_window(parts.windows[first:last])
        rays = _aimed_rays(window, grid)
        inverse[:] = 0.0
        for p in range(first, last):
            _enter(parts, p, rays, False, memory, inverse)
        alone = (inverse > 0.0).sum()
        if alone == 0:
            continue
        for p in range(len(parts.facing)):
            owner = surfaces.owner[p]
            if owner != number and owner != PANE - number and _may_hide(parts.windows[p], window):
                _enter(parts, p, rays, True, memory, inverse)
        if around.scene >= 0:
            _stop_at_world(around, (eye[0], eye[1], eye[2]), rays, inverse)
        share[number] = (inverse > 0.0).sum() / alone
    return share


class _SeenParts(NamedTuple):
    """Parts as the sensor sees them: rows of `Window`, facing planes, and planes of each."""

    windows: NDArray[np.float64]
    facing: NDArray[np.int64]
    planes: NDArray[np.float64]


class _Aimed(NamedTuple):
    """Rays of a grid: cosines and sines of its azimuths and of its elevations."""

    cosines: NDArray[np.float64]
    sines: NDArray[np.float64]
    level: NDArray[np.float64]
    rise: NDArray[np.float64]


@inner
def _seen_parts(viewpoint, surfaces):
    """Return the parts as they are seen from the viewpoint."""
    number, upright, corners = len(surfaces.owner), np.eye(3), np.empty((8, 3))
    windows, facing = np.empty((number, 8)), np.empty(number, np.int64)
    planes = np.empty((number, 6, 5))
    for p in range(number):
        fill_corners(surfaces.geometry[p], corners)
        for n, bound in enumerate(window_of(corners, viewpoint, upright)):
            windows[p, n] = bound
        facing[p] = fill_planes(surfaces.geometry[p], viewpoint, upright, planes[p])
    return _SeenParts(windows, facing, planes)


@inner
def _joint_window(windows):
    """Return the `Window` that holds those of all parts of an object."""
    azimuth = windows[0, 0] if len(windows) else 0.0
    right = left = farthest = 0.0
    lowest, highest, nearest, axis_distance = np.inf, -np.inf, np.inf, np.inf
    for row in windows:
        turn = shorter_turn(azimuth, row[0])
        right, left = max(right, row[1] - turn), max(left, row[2] + turn)
        lowest, highest = min(lowest, row[3]), max(highest, row[4])
        nearest, farthest = min(nearest, row[5]), max(farthest, row[6])
        axis_distance = min(axis_distance, row[7])
    right, left = min(right, math.pi), min(left, math.pi)
    return Window(azimuth, right, left, lowest, highest, nearest, farthest, axis_distance)


@inner
def _aimed_rays(window, grid):
    """Return a grid of rays over the angles of a window."""
    height, width = grid
    cosines, sines = np.empty(width), np.empty(width)
    level, rise = np.empty(height), np.empty(height)
    for i in range(width):
        azimuth = window.azimuth - window.right + (window.right + window.left) * (i + 0.5) / width
        cosines[i], sines[i] = math.cos(azimuth), math.sin(azimuth)
    for j in range(height):
        elevation = window.lowest + (window.highest - window.lowest) * (j + 0.5) / height
        level[j], rise[j] = math.cos(elevation), math.sin(elevation)
    return _Aimed(cosines, sines, level, rise)


@inner
def _enter(parts, p, rays, hides, memory, inverse):
    """Let rays enter a part: it is one of the object, or it hides what is behind."""
    facing, planes, (cosines, sines, level, rise) = parts.facing[p], parts.planes[p], rays
    for j in range(len(level) if facing > 0 else 0):
        enter_along(cosines, sines, planes, facing, level[j], rise[j], memory)
        entered = inverse[j]
        if hides:
            for i in range(len(memory)):
                entered[i] = entered[i] if entered[i] >= memory[i] else -1.0
        else:
            for i in range(len(memory)):
                entered[i] = max(entered[i], memory[i])


@inner
def _may_hide(row, window):
    """Return whether a part, by its row of `Window`, may be before an object with this window."""
    turn = abs(shorter_turn(window.azimuth, row[0]))
    widths = max(window.right, window.left) + max(row[1], row[2])
    return (
        row[5] <= window.farthest
        and turn <= widths + 1e-9
        and row[3] <= window.highest
        and row[4] >= window.lowest
    )


@inner
def _stop_at_world(around, eye, rays, inverse):
    """Let rays stop that meet the world before the object."""
    width = len(rays.cosines)
    for j in range(len(rays.level)):
        ce, se = rays.level[j], rays.rise[j]
        for i in range(width):
            if inverse[j, i] > 0.0:
                way = turned(around.turn, ce * rays.cosines[i], ce * rays.sines[i], se)
                most, ray = 1.0 / inverse[j, i], j * width + i
                if first_met(eye, way, most, ray, around.worlds, around.scene)[0] < most:
                    inverse[j, i] = -1.0


def occluded(share: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return KITTI's levels 0 to 3 of visible shares; see `OCCLUDED`."""
    full, partly = OCCLUDED
    return np.select([share >= full, share >= partly, share > 0], [0, 1, 2], 3)


def ground_truth(
    log: BoxLog, x: Interval, y: Interval, z: Interval, seed: int = 0, by_points: bool = False
) -> pd.DataFrame:
    """Return the objects that count: centre in the ROI x, y, z, faces included, and visible.

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

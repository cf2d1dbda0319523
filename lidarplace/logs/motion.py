"""Motion of objects and of the vehicle in a log: central differences along tracks and poses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import POSE_COLUMNS

MOST_GAP_S = 1.0
"""Longest time between two frames over which motion is known, seconds."""


@dataclass(frozen=True, eq=False)
class LogMotion:
    """Velocities over ground and yaw rates, in the axes of the vehicle in each frame; m/s, rad/s.

    What has no neighbour in time stands still.

    Attributes:
        frames: of the vehicle in every row of the log's frames, shape (F, 3).
        boxes: of every row of its boxes, shape (B, 3)."""

    frames: NDArray[np.float64]
    boxes: NDArray[np.float64]


def motion_in(log: BoxLog) -> LogMotion:
    """Find the motion in a log.

    Raises ValueError: the log has a static world, the pose of the vehicle is missing, frames are
    more than MOST_GAP_S apart, or no object is in two successive frames."""
    if log.world:
        problem, fix = "a static world does not move", "remove rate_hz, or world.npz of the log"
        raise InputError(problem, key="rate_hz", fix=fix)
    need = "a LiDAR with rate_hz needs motion"
    if missing := [name for name in POSE_COLUMNS if name not in log.frames.columns]:
        wrong = f"missing column; {need}, from the pose of the vehicle"
        raise InputError(wrong, place="frames", key=", ".join(missing))
    frames = log.frames[["scene", "route", "frame", "timestamp_s"]].reset_index(drop=True)
    pose = log.frames[list(POSE_COLUMNS)].to_numpy(np.float64)
    if (bad := ~np.isfinite(pose).all(axis=1)).any():
        place, found = f"frames: frame {frames['frame'][bad.argmax()]}", pose[bad.argmax()].tolist()
        expected = "a finite pose of the vehicle, because a LiDAR has rate_hz"
        raise InputError(place=place, expected=expected, found=found)
    time = frames["timestamp_s"].to_numpy(np.float64)
    route = _codes(frames, ["scene", "route"])
    order = np.lexsort((time, route))
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    of_frames, linked = _rates(route, number, time, pose, 2 * np.pi)
    if len(frames) and not linked:
        expected = f"frames of a route at most {MOST_GAP_S:g} s apart"
        raise InputError(need, place="frames", key="timestamp_s", expected=expected)

    at = pd.Index(frames["frame"]).get_indexer(log.boxes["frame"])
    x, y, yaw = log.boxes[["x", "y", "yaw"]].to_numpy(np.float64).T
    c, s = np.cos(pose[at, 2]), np.sin(pose[at, 2])
    world = pose[at] + np.stack([c * x - s * y, s * x + c * y, yaw], axis=1)
    track = _codes(log.boxes.assign(route=route[at]), ["route", "object_id"])
    # A label may turn round from one frame to the next: half a turn is none.
    of_boxes, linked = _rates(track, number[at], time[at], world, np.pi)
    if len(log.boxes) and not linked:
        raise InputError(f"no object is in two successive frames; {need}", key="object_id")
    return LogMotion(_turned(of_frames, pose[:, 2]), _turned(of_boxes, pose[at, 2]))


def _codes(table: pd.DataFrame, names: Sequence[str]) -> NDArray[np.int64]:
    return np.asarray(table.groupby(list(names), sort=False, dropna=False).ngroup(), np.int64)


def _rates(
    group: NDArray[np.int64],
    number: NDArray[np.int64],
    time: NDArray[np.float64],
    place: NDArray[np.float64],
    period: float,
) -> tuple[NDArray[np.float64], bool]:
    """Return central differences of x, y and yaw, (n, 3), and whether any has a neighbour.

    Neighbours are of one group and have successive numbers; `period` is that of the yaw."""
    order = np.lexsort((number, group))
    gap, successive = np.diff(time[order]), np.diff(number[order]) == 1
    linked = (np.diff(group[order]) == 0) & successive & (gap > 0) & (gap <= MOST_GAP_S)
    rows = np.arange(len(order))
    first = order[rows - np.append(False, linked)[: len(rows)]]
    last = order[rows + np.append(linked, False)[: len(rows)]]
    away, span = place[last] - place[first], (time[last] - time[first])[:, None]
    away[:, 2] = (away[:, 2] + 0.5 * period) % period - 0.5 * period
    rates = np.zeros_like(place)
    rates[order] = np.divide(away, span, out=np.zeros_like(away), where=span > 0)
    return rates, bool(linked.any())


def _turned(rates: NDArray[np.float64], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn velocities in the world into the axes of a vehicle of this yaw."""
    (x, y, turn), c, s = rates.T, np.cos(yaw), np.sin(yaw)
    return np.stack([c * x + s * y, c * y - s * x, turn], axis=1)

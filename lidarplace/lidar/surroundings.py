"""What stands around the vehicle in a frame of a box log: its objects and the buildings nearby."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarplace.box_log import BoxLog
from lidarplace.boxes import GEOMETRY, POSE_COLUMNS, check_boxes
from lidarplace.lidar.shapes import (
    BUILDING,
    BUILDING_REFLECTIVITY,
    Parts,
    bricks,
    shapes_of,
)


class Surroundings:
    """The parts in every frame of a log.

    Args:
        log: objects, frames and buildings.
        seed: decides the shapes of the objects together with their ids.

    Raises:
        ValueError: a box is bad, a frame is listed twice, or buildings stand in a scene of which a
            frame has no pose.
    """

    def __init__(self, log: BoxLog, seed: int = 0) -> None:
        check_boxes(log.boxes)
        self._shapes = shapes_of(log.boxes, seed)
        frame = log.boxes["frame"].to_numpy(np.int64)
        self._rows = np.argsort(frame, kind="stable")
        self._frame = frame[self._rows]
        self._geometry = log.boxes[list(GEOMETRY)].to_numpy(np.float64)
        numbers = log.frames["frame"].to_numpy(np.int64)
        if len(np.unique(numbers)) < len(numbers):
            raise ValueError("box log: a frame is listed twice in its frames")
        self._listed = set(numbers.tolist())
        self._buildings = {
            scene: table[list(GEOMETRY)].to_numpy(np.float64)
            for scene, table in log.buildings.groupby("scene", sort=False)
        }
        self._poses = self._poses_of(log) if self._buildings else {}

    def _poses_of(self, log: BoxLog) -> dict[int, tuple[str, NDArray[np.float64]]]:
        """Scene and pose of every frame that has buildings."""
        missing = [name for name in POSE_COLUMNS if name not in log.frames.columns]
        if missing:
            raise ValueError(
                f"frames: no column {', '.join(missing)}; buildings need the pose of the vehicle"
            )
        frames = log.frames[log.frames["scene"].isin(list(self._buildings))]
        poses = frames[list(POSE_COLUMNS)].to_numpy(np.float64)
        numbers, scenes = frames["frame"].tolist(), frames["scene"].tolist()
        bad = ~np.isfinite(poses).all(axis=1)
        if bad.any():
            raise ValueError(
                f"frames: frame {numbers[int(bad.argmax())]} needs a finite pose of the vehicle, "
                f"found {poses[bad.argmax()].tolist()}; its scene has buildings"
            )
        return {n: (s, p) for n, s, p in zip(numbers, scenes, poses, strict=True)}

    def rows(self, frame: int) -> NDArray[np.int64]:
        """Rows of the log's boxes in this frame, in their order."""
        first, last = np.searchsorted(self._frame, [frame, frame + 1])
        return self._rows[first:last]

    def parts(self, frame: int, reach: float) -> Parts:
        """Objects of the frame, owners numbered as in `rows`, and buildings, in the ego frame.

        Buildings farther than `reach` metres from the vehicle are left out.

        Raises:
            ValueError: the log does not list this frame.
        """
        if frame not in self._listed:
            raise ValueError(f"frame {frame} is not in the box log")
        rows = self.rows(frame)
        objects = self._shapes.parts(rows, self._geometry[rows])
        if frame not in self._poses:
            return objects
        scene, (x, y, yaw) = self._poses[frame]
        buildings = self._buildings[scene]
        dx, dy = buildings[:, 0] - x, buildings[:, 1] - y
        near = np.hypot(dx, dy) - 0.5 * np.hypot(buildings[:, 3], buildings[:, 4]) <= reach
        moved = buildings[near]
        dx, dy, c, s = dx[near], dy[near], np.cos(yaw), np.sin(yaw)
        moved[:, 0], moved[:, 1] = c * dx + s * dy, c * dy - s * dx
        moved[:, 6] -= yaw
        return objects.and_(bricks(moved, BUILDING, BUILDING_REFLECTIVITY))

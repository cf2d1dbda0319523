"""Surroundings of the vehicle in a frame of a box log: objects, buildings, world and the ground."""

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.clouds.ground import CELL_M, CELLS, Ground, square
from lidarplace.clouds.moving import Motion, part_motion
from lidarplace.clouds.reflectivity import Material, reflectivity, uniforms
from lidarplace.clouds.shapes import BUILDING, PANE, SIGN, Parts, bricks, shapes_of
from lidarplace.clouds.worlds import WorldAround, worlds_of
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, POSE_COLUMNS, check_boxes, full_poses
from lidarplace.logs.motion import LogMotion, motion_in

SIGN_M = 0.6
"""Edge of a sign, one in front of a building and one behind it."""
SIGN_HEIGHT_M = (1.0, 3.0)
"""Bottom of a sign above that of the building."""
_PROUD_M = 0.05  # how far a sign stands out of the wall
_MOST_PARTS = 1 << 18  # parts that are kept, 24 MB


class Surroundings:
    """The parts and the ground in every frame of a log.

    `seed` decides what objects look like together with their ids, and buildings and ground together
    with their place. Several rigs can share one. Raises ValueError for a bad box, a frame that is
    listed twice, or a frame without a pose in a scene with buildings or a world."""

    def __init__(self, log: BoxLog, seed: int = 0) -> None:
        check_boxes(log.boxes)
        self.log, self.seed = log, seed
        self._shapes = shapes_of(log.boxes, seed)
        self._classes = log.boxes["class"]
        frame = log.boxes["frame"].to_numpy(np.int64)
        self._rows = np.argsort(frame, kind="stable")
        self._frame = frame[self._rows]
        self._geometry = log.boxes[list(GEOMETRY)].to_numpy(np.float64)
        numbers = log.frames["frame"].to_numpy(np.int64)
        if len(np.unique(numbers)) < len(numbers):
            raise InputError("duplicate frame", place="box log: frames", key="frame")
        self._listed = set(numbers.tolist())
        scenes = log.buildings.groupby("scene", sort=False)[list(GEOMETRY)]
        self._buildings = {s: facades(boxes.to_numpy(np.float64), seed) for s, boxes in scenes}
        self.worlds, self._scenes = worlds_of(log.world), {s: n for n, s in enumerate(log.world)}
        self._poses = self._poses_of(log)
        self._places = full_poses(log.frames) if log.world else {}
        self._parts: dict[tuple[int, float], Parts] = {}
        self._kept = 0

    def _poses_of(self, log: BoxLog) -> dict[int, tuple[str, NDArray[np.float64]]]:
        """Return scene and pose of every frame that has a finite one."""
        missing = [name for name in POSE_COLUMNS if name not in log.frames.columns]
        placed = [*self._buildings, *self._scenes]
        if missing and placed:
            needy = "buildings need" if self._buildings else "a static world needs"
            wrong = f"missing column; {needy} the pose of the vehicle"
            raise InputError(wrong, place="frames", key=", ".join(missing))
        if missing:
            return {}
        columns = log.frames[list(POSE_COLUMNS)].apply(pd.to_numeric, errors="coerce")
        poses = columns.to_numpy(np.float64, na_value=np.nan)
        numbers, scenes = log.frames["frame"].tolist(), log.frames["scene"]
        finite = np.isfinite(poses).all(axis=1)
        bad = ~finite & scenes.isin(placed).to_numpy()
        if bad.any():
            reason = "buildings" if self._buildings else "a static world"
            expected = f"a finite pose of the vehicle, because its scene has {reason}"
            where, found = f"frames: frame {numbers[bad.argmax()]}", poses[bad.argmax()].tolist()
            raise InputError(place=where, expected=expected, found=found)
        rows = zip(numbers, scenes, poses, finite, strict=True)
        return {n: (scene, pose) for n, scene, pose, is_finite in rows if is_finite}

    def rows(self, frame: int) -> NDArray[np.int64]:
        """Return the rows of the log's boxes in this frame, in their order."""
        first, last = np.searchsorted(self._frame, [frame, frame + 1])
        return self._rows[first:last]

    def classes(self, frame: int) -> list[str]:
        """Return the classes of the objects of this frame, numbered as in `rows`."""
        return [str(name) for name in self._classes.iloc[self.rows(frame)]]

    @cached_property
    def _motion(self) -> LogMotion:
        return motion_in(self.log)

    def motion(self, frame: int, parts: Parts) -> Motion:
        """Return the motion of the vehicle and of the `parts` of a frame, its own body included.

        Raises ValueError as `motion_in` does."""
        rows, row = self.rows(frame), self.log.frames["frame"].to_numpy() == frame
        rates = part_motion(parts, self._geometry[rows, :2], self._motion.boxes[rows])
        return Motion(self._motion.frames[row][0], rates)

    def parts(self, frame: int, reach: float) -> Parts:
        """Return objects of the frame, owners numbered as in `rows`, and buildings; ego frame.

        Those farther than `reach` metres from the vehicle are left out."""
        return self._computed([frame], reach)[0]

    def shared_parts(self, frames: Sequence[int], reach: float) -> list[Parts]:
        """Return the `parts` of every frame, faster than one by one; the first ones are kept."""
        by_frame = {f: self._parts[f, reach] for f in frames if (f, reach) in self._parts}
        if missing := [frame for frame in frames if frame not in by_frame]:
            for frame, of_frame in zip(missing, self._computed(missing, reach), strict=True):
                by_frame[frame] = of_frame
                if self._kept < _MOST_PARTS:
                    self._parts[frame, reach] = of_frame
                    self._kept += len(of_frame)
        return [by_frame[frame] for frame in frames]

    def _computed(self, frames: Sequence[int], reach: float) -> list[Parts]:
        rows = [self._checked_rows(frame) for frame in frames]
        together = np.concatenate([np.empty(0, np.int64), *rows])
        objects = self._shapes.parts(together, self._geometry[together])
        first = [0, *np.cumsum([len(of_frame) for of_frame in rows]).tolist()]
        opaque = objects.owner >= 0
        number = np.where(opaque, objects.owner, PANE - objects.owner)
        ends = np.searchsorted(number, first).tolist()
        shift = np.where(opaque, -1, 1) * np.repeat(np.array(first[:-1], np.int64), np.diff(ends))
        owner = (objects.owner + shift).astype(np.int32)
        parts = []
        for frame, (start, end) in zip(frames, pairwise(ends), strict=True):
            some = slice(start, end)
            of_frame = Parts(objects.geometry[some], owner[some], objects.reflectivity[some])
            parts.append(self._with_buildings(of_frame, frame, reach))
        return parts

    def _checked_rows(self, frame: int) -> NDArray[np.int64]:
        if frame not in self._listed:
            raise ValueError(f"frame {frame} is not in the box log")
        return self.rows(frame)

    def _with_buildings(self, objects: Parts, frame: int, reach: float) -> Parts:
        """Return parts of objects, and the buildings of a frame."""
        scene, (x, y, yaw) = self._poses.get(frame, ("", np.zeros(3)))
        if scene not in self._buildings:
            return objects
        buildings = self._buildings[scene]
        geometry = buildings.geometry
        dx, dy = geometry[:, 0] - x, geometry[:, 1] - y
        near = np.hypot(dx, dy) - 0.5 * np.hypot(geometry[:, 3], geometry[:, 4]) <= reach
        moved = geometry[near]
        dx, dy, c, s = dx[near], dy[near], np.cos(yaw), np.sin(yaw)
        moved[:, 0], moved[:, 1] = c * dx + s * dy, c * dy - s * dx
        moved[:, 6] -= yaw
        return objects.and_(Parts(moved, buildings.owner[near], buildings.reflectivity[near]))

    def world(self, frame: int) -> WorldAround | None:
        """Return the static world around a frame, and its ground; None where the log has none."""
        scene = self._scenes.get(self._poses.get(frame, ("", None))[0])
        if scene is None:
            return None
        turn, place = self._places[frame]
        return WorldAround(self.worlds, scene, turn, place - self.worlds.origins[scene])

    def ground(self, frame: int) -> Ground:
        """Return the ground of a frame; without a pose of the vehicle a place is drawn for it."""
        cells, level = square(self.seed), self.world(frame) is None
        if frame in self._poses:
            x, y, yaw = self._poses[frame][1].tolist()
            return Ground(cells, (x, y, yaw), level)
        u, v, turn = uniforms(f"{self.seed}/{frame}", 3, b"ground").tolist()
        return Ground(cells, (u * CELLS * CELL_M, v * CELLS * CELL_M, turn * 2 * np.pi), level)


def facades(buildings: NDArray[np.float64], seed: int) -> Parts:
    """Return walls of buildings, rows of `GEOMETRY` in the world, (B, 7), and two signs on each.

    Both are drawn from a hash of seed and place, so a building looks the same in every run through
    its town. Signs front and back are one bar, of which only the ends stand out."""
    number = len(buildings)
    drawn = [uniforms(f"{seed}/{x:.2f}/{y:.2f}", 4, b"facade") for x, y in buildings[:, :2]]
    wall, sign, along, up = np.array(drawn).reshape(number, 4).T
    low, high = SIGN_HEIGHT_M
    x, y, z, length, width, height, yaw = buildings.T
    edge, tall = np.minimum(SIGN_M, length), np.minimum(SIGN_M, height)
    aside = (along - 0.5) * (length - edge)
    bottom = np.minimum(low + (high - low) * up, height - tall)
    x, y, z = x + np.cos(yaw) * aside, y + np.sin(yaw) * aside, z - height / 2 + bottom + tall / 2
    signs = np.stack([x, y, z, edge, width + 2 * _PROUD_M, tall, yaw], axis=1)
    light = reflectivity(np.full(number, Material.RETROREFLECTOR), sign)
    walls = bricks(buildings, BUILDING, reflectivity(np.full(number, Material.WALL), wall))
    return walls.and_(bricks(signs, SIGN, light))

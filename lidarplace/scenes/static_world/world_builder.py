"""Build the static world of a scene from recorded clouds and poses, frame by frame.

1. Each frame counts the points in cells, and the rays that pass through them (`cell_counts`).
2. Tiles that the vehicle leaves behind are condensed, so memory does not grow with the points:
   cells that enough frames hit and that stop enough of their rays stand still.
3. The lowest cells of each column are ground where it grows from under the path (`ground`).
4. What stands out of the ground is the world."""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import PointClouds
from lidarplace.clouds.points_in_boxes import box_of_points
from lidarplace.clouds.shapes import OWN_BODY
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, POSE_COLUMNS, full_poses
from lidarplace.logs.world import (
    CELL_M,
    HALF_LEVELS,
    HALF_TILES,
    PATCHES,
    TILE,
    TILE_M,
    StaticWorld,
)
from lidarplace.scenes.static_world.cell_counts import (
    REACH_M,
    count_passes,
    count_points,
    list_rows,
    new_counts,
    static_cells,
)
from lidarplace.scenes.static_world.ground import (
    Ground,
    corner_heights,
    grow_ground,
    lowest_cells,
    out_of_ground,
    tile_key,
    tiles_of_blocks,
)

LEAST_FRAMES = 3  # frames that hit a cell that stands still; fewer if the scene has fewer
MARGIN_M = 0.2  # labelled boxes are grown by so much to all sides: labels err


def static_worlds(log: BoxLog, clouds: Iterable[PointClouds]) -> dict[str, StaticWorld]:
    """Build the static world of every scene of a log, whose rigs say where rays start.

    `clouds` are of its frames, in the ego frame; those of a scene follow each other. Raises
    ValueError if a frame has no pose, a scene no rig, or clouds distinguish other LiDARs."""
    if missing := [name for name in POSE_COLUMNS if name not in log.frames.columns]:
        problem, names = "a static world needs poses of the vehicle", f"no {', '.join(missing)}"
        raise InputError(problem, place="frames", expected=", ".join(POSE_COLUMNS), found=names)
    poses = full_poses(log.frames)
    scene_of = dict(zip(log.frames["frame"].tolist(), log.frames["scene"], strict=True))
    rows_of = log.boxes.groupby("frame").indices
    geometry = log.boxes[list(GEOMETRY)].to_numpy(np.float64)
    builders: defaultdict[str, WorldBuilder] = defaultdict(WorldBuilder)
    for part in clouds:
        for index, frame in enumerate(part.frames.tolist()):
            scene = scene_of[frame]
            eyes = _ray_origins(log, scene, part.counts.shape[1])
            if frame not in poses:
                problem = "a static world needs the pose of every frame with a cloud"
                raise InputError(problem, place=f"frames: frame {frame}", expected="finite numbers")
            boxes = geometry[rows_of.get(frame, np.empty(0, np.int64))]
            builders[scene].add(part[index], part.lidar(index), eyes, *poses[frame], boxes)
    return {scene: builder.world() for scene, builder in builders.items()}


def _ray_origins(log: BoxLog, scene: str, lidars: int) -> NDArray[np.float64]:
    """Return where the rays of each LiDAR of a scene start, ego frame, shape (LiDARs, 3).

    Points of an unknown LiDAR start in the middle of the rig."""
    place = f"scene {scene}"
    if scene not in log.rigs:
        problem = "a static world needs the rig that recorded the clouds"
        raise InputError(problem, place=place, fix="--rig names a file of mounts")
    eyes = np.array([mount.position for mount in log.rigs[scene].placement.mounts])
    if lidars == 1:
        return np.asarray(eyes.mean(axis=0, keepdims=True))
    if lidars != len(eyes):
        problem = "clouds of other LiDARs than the rig's"
        raise InputError(problem, place=place, expected=len(eyes), found=lidars)
    return eyes


class WorldBuilder:
    """Builder of the static world of one scene, which takes its frames in their order."""

    def __init__(self) -> None:
        self._origin: NDArray[np.float64] | None = None
        self._counts = new_counts(2**10)
        self._frames = 0
        self._condensed_at = np.full(2, np.inf)
        self._path: list[NDArray[np.float64]] = []
        self._condensed: list[tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.int64]]] = []
        self._lowest: Ground = {}

    def add(
        self,
        points: NDArray[np.float32],
        lidar: NDArray[np.uint8],
        eyes: NDArray[np.float64],
        turn: NDArray[np.float64],
        position: NDArray[np.float64],
        boxes: NDArray[np.float64],
    ) -> None:
        """Add a frame; raise ValueError if it is farther from the first than a world reaches.

        Points with intensity, (n, 4), are of the LiDAR of a number, (n,), whose rays start at
        `eyes`, (LiDARs, 3); labelled boxes are rows of `GEOMETRY`, (m, 7); all in the ego frame.
        `turn`, (3, 3), and `position`, (3,), lead from there to the world of the scene."""
        shift = self._place_frame(position)
        in_box = box_of_points(points, np.vstack([boxes, OWN_BODY]), MARGIN_M) >= 0
        view = turn / CELL_M, shift / CELL_M
        counted = count_points(points, in_box, *view, 0, self._frames, self._counts)
        while counted < len(points):
            self._counts = new_counts(2 * len(self._counts.keys), self._counts)
            counted = count_points(points, in_box, *view, counted, self._frames, self._counts)
        count_passes(points, lidar, eyes, *view, self._frames, self._counts)
        if not np.hypot(*(shift[:2] - self._condensed_at)) < TILE_M:
            self._condensed_at = shift[:2].copy()
            self._condense(shift[:2], REACH_M + TILE_M)

    def _place_frame(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the position from the origin of the world, which is at the first frame."""
        if self._origin is None:
            self._origin = np.floor(position / TILE_M) * TILE_M
        shift = np.asarray(position - self._origin)
        limits = np.array([HALF_TILES, HALF_TILES, HALF_LEVELS / TILE]) * TILE_M - 2 * REACH_M
        if (np.abs(shift) > limits).any():
            place, away = f"poses: frame {self._frames}", f"{np.abs(shift).max():.4g} m"
            expected = f"at most {limits[0]:.4g} m, and {limits[2]:.4g} m of height, from the first"
            raise InputError(place=place, expected=expected, found=away)
        self._path.append(shift)
        self._frames += 1
        return shift

    def world(self) -> StaticWorld:
        """Return what stood still, and the ground; the builder is used up."""
        self._condense(np.zeros(2), -1.0)
        nothing = np.empty(0, np.int64), np.empty((0, 8), np.uint8), np.empty(0, np.int64)
        parts = zip(nothing, *self._condensed, strict=True)
        keys, cells, weight = (np.concatenate(arrays) for arrays in parts)
        # of two visits to a place the one with more information
        order = np.lexsort((-weight, keys))
        keys, first = np.unique(keys[order], return_index=True)
        cells, ground = cells[order][first], self._ground(self._lowest)
        standing = out_of_ground(keys, cells, ground)
        origin = np.zeros(3) if self._origin is None else self._origin
        tiles = np.array([*ground], np.int32).reshape(-1, 2)
        corners = np.array([corner_heights(tile, ground) for tile in ground], np.float32)
        heights = corners.reshape(-1, PATCHES + 1, PATCHES + 1)
        return StaticWorld(origin, keys[standing], cells[standing], tiles, heights)

    def _ground(self, tiles: Iterable[tuple[int, int]]) -> Ground:
        """Compute the ground of tiles that have any, by those around them too; NaN: unknown."""
        steps = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
        around = {(i + a, j + b) for i, j in tiles for a, b in steps} & self._lowest.keys()
        if not around:
            return {}
        chosen = np.array(sorted(around))
        heights = grow_ground(
            tile_key(chosen[:, 0], chosen[:, 1]),
            np.array([self._lowest[tile] for tile in sorted(around)]),
            np.array(self._path),
        )
        ground = dict(zip(sorted(around), heights, strict=True))
        return {tile: ground[tile] for tile in tiles if np.isfinite(ground.get(tile, np.nan)).any()}

    def _condense(self, centre: NDArray[np.float64], reach: float) -> None:
        """Keep what stands still in tiles farther than `reach`, and forget how it was counted."""
        rows = np.flatnonzero(self._counts.keys >= 0)
        i, j = tiles_of_blocks(self._counts.keys[rows])
        distance = np.hypot((i + 0.5) * TILE_M - centre[0], (j + 0.5) * TILE_M - centre[1])
        rows = rows[distance > reach]
        rows = rows[np.argsort(self._counts.keys[rows])]
        if not len(rows):
            return
        block_keys = self._counts.keys[rows]
        least = min(LEAST_FRAMES, self._frames)
        keys, cells, points = static_cells(self._counts.cells, rows, block_keys, least)
        columns = np.unique(block_keys // (2 * HALF_LEVELS))
        lowest = lowest_cells(keys, cells, columns)
        new: Ground = {}
        tiles = tiles_of_blocks(columns * 2 * HALF_LEVELS)
        for ti, tj, column, height in zip(*tiles, columns, lowest, strict=True):
            heights = new.setdefault((int(ti), int(tj)), np.full((TILE, TILE), np.nan))
            heights[divmod(int(column % TILE**2), TILE)] = height
        for tile, heights in new.items():
            older = self._lowest.get(tile, heights)
            self._lowest[tile] = np.where(np.isnan(heights), older, heights)
        standing = out_of_ground(keys, cells, self._ground(new))
        self._condensed.append((keys[standing], cells[standing], points[standing]))
        self._counts.keys[rows] = -1
        self._counts.cells[rows] = 0
        list_rows(self._counts)

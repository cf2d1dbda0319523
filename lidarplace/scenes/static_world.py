"""Build the static world of a scene from recorded clouds and poses, frame by frame.

A cell counts the points in it, the frames that they are of, and the rays that pass through the
middle of where its points are. What is in a labelled box counts as if rays had passed. Cells that
enough frames hit and that stop enough of their rays stand still; the lowest of them are ground.
Tiles that the vehicle leaves behind are condensed, so memory does not grow with the points."""

import math
from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import inner, njit
from lidarplace.clouds.clouds import PointClouds
from lidarplace.clouds.points_in_boxes import box_of_points
from lidarplace.clouds.shapes import OWN_BODY
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY, POSE_COLUMNS, full_poses
from lidarplace.logs.world import (
    BLOCK,
    CELL_M,
    HALF_LEVELS,
    HALF_TILES,
    PATCHES,
    TILE,
    TILE_M,
    StaticWorld,
    cell_keys,
    cells_of_keys,
)

LEAST_FRAMES = 3  # frames that hit a cell that stands still; fewer if the scene has fewer
LEAST_SHARE = 0.2  # of the rays at a cell, that it stops; what moves is in a cell for a moment only
REACH_M = 100.0  # points farther from the vehicle are left out: too few hit a cell there
CLEAR_M = 0.35  # lower above the ground nothing stands: it is ground
MARGIN_M = 0.2  # labelled boxes are grown by so much to all sides: labels err
_BEHIND_M = 0.5  # a ray passes a cell if it ends so far behind: it may end at the same surface
_STEEPEST, _KERB_M = 0.08, 0.08  # of the ground, from column to column
_AROUND = 3  # columns among which ground is compared, and over which gaps are filled
_EDGE_M = BLOCK * CELL_M  # of a column
_EVERY = 4  # of the rays one in so many is followed to what it passes; in turn
_MANY = 60_000  # counts are halved at this number
_HITS, _PASSES, _LIGHT, _FRAMES, _LAST, _X, _Y, _Z = range(8)


class _State(NamedTuple):
    """Counts of the cells around the vehicle, by blocks in a hash table."""

    table: NDArray[np.int64]  # rows of blocks by hash of their keys, -1 where free
    keys: NDArray[np.int64]  # of the blocks, -1 for a row without one
    free: NDArray[np.int64]  # rows without a block, the first `size[0]` of them
    size: NDArray[np.int64]  # shape (1,)
    cells: NDArray[np.uint16]
    """Points, passes, mean intensity in 1/65280, frames, the last of them, and from where to where
    along x, y and z points are, in 1/256, the upper end in the high byte; shape (rows, 512, 8)."""


def static_worlds(log: BoxLog, clouds: Iterable[PointClouds]) -> dict[str, StaticWorld]:
    """The static world of every scene of a log, whose rigs say where rays start. `clouds` are of
    its frames, in the ego frame; those of a scene follow each other. Raises ValueError if a frame
    has no pose, a scene no rig, or clouds distinguish other LiDARs."""
    if missing := [name for name in POSE_COLUMNS if name not in log.frames.columns]:
        problem, found = "a static world needs poses of the vehicle", f"no {', '.join(missing)}"
        raise InputError(problem, place="frames", expected=", ".join(POSE_COLUMNS), found=found)
    places = full_poses(log.frames)
    scene_of = dict(zip(log.frames["frame"].tolist(), log.frames["scene"], strict=True))
    rows_of = log.boxes.groupby("frame").indices
    geometry = log.boxes[list(GEOMETRY)].to_numpy(np.float64)
    builders: defaultdict[str, WorldBuilder] = defaultdict(WorldBuilder)
    for part in clouds:
        for index, frame in enumerate(part.frames.tolist()):
            scene = scene_of[frame]
            eyes = _eyes(log, scene, part.counts.shape[1])
            if frame not in places:
                problem = "a static world needs the pose of every frame with a cloud"
                raise InputError(problem, place=f"frames: frame {frame}", expected="finite numbers")
            boxes = geometry[rows_of.get(frame, np.empty(0, np.int64))]
            builders[scene].add(part[index], part.lidar(index), eyes, *places[frame], boxes)
    return {scene: builder.world() for scene, builder in builders.items()}


def _eyes(log: BoxLog, scene: str, lidars: int) -> NDArray[np.float64]:
    """Where the rays of each LiDAR of a scene start, ego frame, shape (LiDARs, 3). Points of an
    unknown LiDAR start in the middle of the rig."""
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


Ground = dict[tuple[int, int], NDArray[np.float64]]
"""Heights in the columns of tiles, by i and j, metres above the origin, shape (16, 16) each."""


class WorldBuilder:
    """Takes the frames of a scene in their order, and makes its world."""

    def __init__(self) -> None:
        self._origin: NDArray[np.float64] | None = None
        self._state = _state(2**10)
        self._frames = 0
        self._tidied = np.full(2, np.inf)
        self._path: list[NDArray[np.float64]] = []
        self._found: list[tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.int64]]] = []
        self._lows: Ground = {}

    def add(
        self,
        points: NDArray[np.float32],
        lidar: NDArray[np.uint8],
        eyes: NDArray[np.float64],
        turn: NDArray[np.float64],
        place: NDArray[np.float64],
        boxes: NDArray[np.float64],
    ) -> None:
        """Add a frame: points with intensity, (n, 4), of the LiDAR of a number, (n,), at `eyes`,
        (LiDARs, 3), and labelled boxes, rows of `GEOMETRY`, (m, 7), all in the ego frame. `turn`,
        (3, 3), and `place`, (3,), lead from there to the world of the scene. Raises ValueError if
        the vehicle is farther from the first frame than a world reaches."""
        if self._origin is None:
            self._origin = np.floor(place / TILE_M) * TILE_M
        shift = place - self._origin
        limits = np.array([HALF_TILES, HALF_TILES, HALF_LEVELS / TILE]) * TILE_M - 2 * REACH_M
        if (np.abs(shift) > limits).any():
            where, found = f"poses: frame {self._frames}", f"{np.abs(shift).max():.4g} m"
            expected = f"at most {limits[0]:.4g} m, and {limits[2]:.4g} m of height, from the first"
            raise InputError(place=where, expected=expected, found=found)
        self._path.append(shift)
        self._frames += 1
        owned = box_of_points(points, np.vstack([boxes, OWN_BODY]), MARGIN_M) >= 0
        view = turn / CELL_M, shift / CELL_M
        done = _count_points(points, owned, *view, 0, self._frames, self._state)
        while done < len(points):
            self._state = _state(2 * len(self._state.keys), self._state)
            done = _count_points(points, owned, *view, done, self._frames, self._state)
        _count_passes(points, lidar, eyes, *view, self._frames, self._state)
        if not np.hypot(*(shift[:2] - self._tidied)) < TILE_M:
            self._tidied = shift[:2].copy()
            self._condense(shift[:2], REACH_M + TILE_M)

    def world(self) -> StaticWorld:
        """What stood still, and the ground; the builder is used up."""
        self._condense(np.zeros(2), -1.0)
        nothing = np.empty(0, np.int64), np.empty((0, 8), np.uint8), np.empty(0, np.int64)
        found = zip(nothing, *self._found, strict=True)
        keys, cells, weight = (np.concatenate(parts) for parts in found)
        # of two visits to a place the one with more information
        order = np.lexsort((-weight, keys))
        keys, first = np.unique(keys[order], return_index=True)
        cells, ground = cells[order][first], self._ground(self._lows)
        above = _above(keys, cells, ground)
        origin = np.zeros(3) if self._origin is None else self._origin
        tiles = np.array([*ground], np.int32).reshape(-1, 2)
        corners = np.array([_corners(tile, ground) for tile in ground], np.float32)
        heights = corners.reshape(-1, PATCHES + 1, PATCHES + 1)
        return StaticWorld(origin, keys[above], cells[above], tiles, heights)

    def _ground(self, tiles: Iterable[tuple[int, int]]) -> Ground:
        """The ground of tiles that have any, by those around them too; NaN: unknown."""
        steps = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
        chosen = sorted({(i + a, j + b) for i, j in tiles for a, b in steps} & self._lows.keys())
        if not chosen:
            return {}
        place = np.array(chosen)
        heights = _grown(
            (place[:, 0] + HALF_TILES) * 2 * HALF_TILES + place[:, 1] + HALF_TILES,
            np.array([self._lows[at] for at in chosen]),
            np.array(self._path),
        )
        known = dict(zip(chosen, heights, strict=True))
        return {at: known[at] for at in tiles if at in known and np.isfinite(known[at]).any()}

    def _condense(self, centre: NDArray[np.float64], reach: float) -> None:
        """Keep what stands still in tiles farther than `reach`, and forget how it was counted."""
        rows = np.flatnonzero(self._state.keys >= 0)
        i, j = _tiles(self._state.keys[rows])
        away = np.hypot((i + 0.5) * TILE_M - centre[0], (j + 0.5) * TILE_M - centre[1])
        rows = rows[away > reach]
        rows = rows[np.argsort(self._state.keys[rows])]
        if not len(rows):
            return
        block_keys = self._state.keys[rows]
        least = min(LEAST_FRAMES, self._frames)
        keys, cells, points = _standing(self._state.cells, rows, block_keys, least)
        own = np.unique(block_keys // (2 * HALF_LEVELS))
        lows = _lows(keys, cells, own)
        new: Ground = {}
        for ti, tj, column, low in zip(*_tiles(own * 2 * HALF_LEVELS), own, lows, strict=True):
            tile = new.setdefault((int(ti), int(tj)), np.full((TILE, TILE), np.nan))
            tile[divmod(int(column % TILE**2), TILE)] = low
        for at, tile in new.items():
            self._lows[at] = np.where(np.isnan(tile), self._lows.get(at, tile), tile)
        kept = _above(keys, cells, self._ground(new))
        self._found.append((keys[kept], cells[kept], points[kept]))
        self._state.keys[rows] = -1
        self._state.cells[rows] = 0
        _list_rows(self._state)


def _tiles(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Tiles i and j of keys of blocks."""
    tile = keys // (TILE**2 * 2 * HALF_LEVELS)
    return tile // (2 * HALF_TILES) - HALF_TILES, tile % (2 * HALF_TILES) - HALF_TILES


def _state(rows: int, old: _State | None = None) -> _State:
    """Room for so many blocks, with those of `old`."""
    cells = np.zeros((rows, BLOCK**3, 8), np.uint16)
    keys, free = np.full(rows, -1, np.int64), np.empty(rows, np.int64)
    new = _State(np.empty(4 * rows, np.int64), keys, free, np.empty(1, np.int64), cells)
    if old is not None:
        new.keys[: len(old.keys)], new.cells[: len(old.keys)] = old.keys, old.cells
    _list_rows(new)
    return new


@inner
def _find(table, keys, key):
    """Where in the table a block is, or would be."""
    at = np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(20)) % len(table)
    while table[at] >= 0 and keys[table[at]] != key:
        at = at + np.int64(1) if at + 1 < len(table) else np.int64(0)
    return at


@njit(cache=True, nogil=True)
def _list_rows(state):
    """Set the table, and the rows that are free, by the keys."""
    state.table[:] = -1
    state.size[0] = 0
    for row in range(len(state.keys) - 1, -1, -1):
        if state.keys[row] >= 0:
            state.table[_find(state.table, state.keys, state.keys[row])] = row
        else:
            state.free[state.size[0]] = row
            state.size[0] += 1


@inner
def _key(i, j, k):
    """Key of the block (i, j, k)."""
    tile = (i // TILE + HALF_TILES) * 2 * HALF_TILES + j // TILE + HALF_TILES
    return (tile * TILE**2 + i % TILE * TILE + j % TILE) * 2 * HALF_LEVELS + k + HALF_LEVELS


@njit(cache=True, nogil=True)
def _count_points(points, owned, turn, shift, start, frame, state):
    """Count points in cells from the `start`-th on; return at which one there is no more room."""
    mark = np.uint16(frame % 2**16)
    levels = HALF_LEVELS * BLOCK
    for n in range(start, len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not x * x + y * y + z * z <= REACH_M * REACH_M:
            continue
        u = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + shift[0]
        v = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + shift[1]
        w = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
        i, j, k = math.floor(u), math.floor(v), math.floor(w)
        if not -levels <= k < levels:
            continue
        key = _key(i // BLOCK, j // BLOCK, k // BLOCK)
        at = _find(state.table, state.keys, key)
        if state.table[at] < 0:
            if owned[n]:
                continue
            if state.size[0] == 0:
                return n
            state.size[0] -= 1
            row = state.free[state.size[0]]
            state.table[at], state.keys[row] = row, key
        row = state.table[at]
        cell = state.cells[row, (i % BLOCK * BLOCK + j % BLOCK) * BLOCK + k % BLOCK]
        if owned[n]:
            _count(cell, _PASSES)  # as many rays are not followed, it weighs more
            continue
        if cell[_LAST] != mark or cell[_FRAMES] == 0:
            cell[_LAST] = mark
            if cell[_FRAMES] < _MANY:
                cell[_FRAMES] += np.uint16(1)
        _count(cell, _HITS)
        light = 65280.0 * min(max(points[n, 3], 0.0), 1.0)
        mean = float(cell[_LIGHT])
        cell[_LIGHT] = np.uint16(mean + (light - mean) / cell[_HITS] + 0.5)
        for axis, share in ((_X, u - i), (_Y, v - j), (_Z, w - k)):
            cell[axis] = _wider(cell[axis], min(int(share * 256.0), 255), cell[_HITS] == 1)
    return len(points)


@inner
def _wider(ends, here, first):
    """From where to where points are along an axis, `here` among them, as `_State` has it."""
    low, high = (here, here) if first else (np.int64(ends & 255), np.int64(ends >> 8))
    return np.uint16(min(low, here) | max(high, here) << 8)


@inner
def _count(cell, what):
    """One more; of large counts only the ratio matters."""
    cell[what] += np.uint16(1)
    if cell[what] >= _MANY:
        cell[_HITS] //= np.uint16(2)
        cell[_PASSES] //= np.uint16(2)


@njit(cache=True, nogil=True, error_model="numpy")
def _count_passes(points, lidar, eyes, turn, shift, frame, state):
    """Count the rays that pass through the middle of what is in a cell."""
    p, d, to, width = np.empty((4, 3))
    block, step = np.empty((2, 3), np.int64)
    behind, reach = _BEHIND_M / CELL_M, REACH_M / CELL_M
    for n in range(frame % _EVERY, len(points), _EVERY):
        eye = eyes[lidar[n]]
        length = 0.0
        for axis in range(3):
            p[axis] = last = shift[axis]
            for m in range(3):
                p[axis] += turn[axis, m] * eye[m]
                last += turn[axis, m] * points[n, m]
            d[axis] = last - p[axis]
            length += d[axis] * d[axis]
        length = math.sqrt(length)
        end = min(length - behind, reach)
        if not end > 0.0:
            continue
        for axis in range(3):
            d[axis] /= length
            block[axis] = math.floor(p[axis] / BLOCK)
            step[axis] = 1 if d[axis] > 0.0 else -1
            edge = (block[axis] + (1 if d[axis] > 0.0 else 0)) * BLOCK
            to[axis] = (edge - p[axis]) / d[axis] if d[axis] != 0.0 else np.inf
            width[axis] = abs(BLOCK / d[axis]) if d[axis] != 0.0 else np.inf
        t = 0.0
        while t < end:
            leave = min(to[0], to[1], to[2], end)
            if -HALF_LEVELS <= block[2] < HALF_LEVELS:
                key = _key(block[0], block[1], block[2])
                row = state.table[_find(state.table, state.keys, key)]
                if row >= 0:
                    _pass_block(state.cells[row], p, d, block, step, t, leave)
            t = leave
            axis = 0 if to[0] <= to[1] and to[0] <= to[2] else 1 if to[1] <= to[2] else 2
            block[axis] += step[axis]
            to[axis] += width[axis]


@inner
def _pass_block(cells, p, d, block, step, start, end):
    """Count a ray in the cells of a block that it passes from `start` to `end`."""
    x, y, z = p[0] - block[0] * BLOCK, p[1] - block[1] * BLOCK, p[2] - block[2] * BLOCK
    i = min(max(math.floor(x + start * d[0]), 0), BLOCK - 1)
    j = min(max(math.floor(y + start * d[1]), 0), BLOCK - 1)
    k = min(max(math.floor(z + start * d[2]), 0), BLOCK - 1)
    ti = (i + (step[0] > 0) - x) / d[0] if d[0] != 0.0 else np.inf
    tj = (j + (step[1] > 0) - y) / d[1] if d[1] != 0.0 else np.inf
    tk = (k + (step[2] > 0) - z) / d[2] if d[2] != 0.0 else np.inf
    wi, wj, wk = abs(1.0 / d[0]), abs(1.0 / d[1]), abs(1.0 / d[2])
    while True:
        cell = cells[(i * BLOCK + j) * BLOCK + k]
        if _through_middle(cell, x - i, y - j, z - k, d):
            _count(cell, _PASSES)
        if min(ti, tj, tk) >= end:
            return
        if ti <= tj and ti <= tk:
            i, ti = i + step[0], ti + wi
        elif tj <= tk:
            j, tj = j + step[1], tj + wj
        else:
            k, tk = k + step[2], tk + wk
        if min(i, j, k) < 0 or max(i, j, k) >= BLOCK:
            return


@inner
def _extent(cell, axis):
    """From where to where along an axis something is in a cell, as shares of its edge. Few points
    do not reach to its ends: of n at random a share (n - 1) / (n + 1) is between them."""
    hits = float(cell[_HITS])
    if hits < 2.0:
        return 0.0, 1.0
    low, high = float(cell[axis] & 255) / 256.0, float((cell[axis] >> 8) + 1) / 256.0
    middle, half = 0.5 * (low + high), max(0.5 * (high - low) * (hits + 1.0) / (hits - 1.0), 0.05)
    return max(middle - half, 0.0), min(middle + half, 1.0)


@inner
def _through_middle(cell, x, y, z, d):
    """Whether a ray passes what is in a cell at half of its size, a quarter of its section."""
    near, far = -np.inf, np.inf
    for axis, start, way in ((_X, x, d[0]), (_Y, y, d[1]), (_Z, z, d[2])):
        low, high = _extent(cell, axis)
        low, high = 0.75 * low + 0.25 * high - start, 0.25 * low + 0.75 * high - start
        if way == 0.0:
            if low > 0.0 or high < 0.0:
                return False
            continue
        near, far = max(near, min(low / way, high / way)), min(far, max(low / way, high / way))
    return near <= far


@njit(cache=True, nogil=True)
def _standing(cells, rows, block_keys, least):
    """Keys, cells and points of what stands still in blocks; `least`: frames that hit it."""
    number = 0
    for row in rows:
        for n in range(BLOCK**3):
            number += cells[row, n, _FRAMES] >= least
    keys, points = np.empty((2, number), np.int64)
    found, size = np.empty((number, 8), np.uint8), 0
    for b in range(len(rows)):
        for n in range(BLOCK**3):
            cell = cells[rows[b], n]
            if cell[_FRAMES] < least:
                continue
            passes = 4.0 * _EVERY * float(cell[_PASSES])  # a quarter is through the middle
            share = float(cell[_HITS]) / (float(cell[_HITS]) + passes)
            if share < LEAST_SHARE:
                continue
            keys[size], points[size] = block_keys[b] * BLOCK**3 + n, cell[_HITS]
            for axis in range(3):
                low, high = _extent(cell, _X + axis)
                found[size, axis] = math.floor(255.0 * low)
                found[size, axis + 3] = math.ceil(255.0 * high)
            found[size, 6] = round(255.0 * share)
            found[size, 7] = cell[_LIGHT] // 256
            size += 1
    return keys[:size], found[:size], points[:size]


def _lows(
    keys: NDArray[np.int64], cells: NDArray[np.uint8], columns: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Height above the origin of the lowest cells of columns, in the median over them, metres. NaN
    where there is none. `keys` and `columns` ascend; a column is a key without block and cell."""
    place = cells_of_keys(keys)
    fine, first = np.unique(place[:, :2], axis=0, return_inverse=True)
    height = CELL_M * (place[:, 2] + (cells[:, 2] + 0.0 + cells[:, 5]) / 510.0)
    lowest = np.full(len(fine), np.inf)
    np.minimum.at(lowest, first.ravel(), height)
    own = cell_keys(np.c_[fine, np.full(len(fine), -HALF_LEVELS * BLOCK)])
    medians = pd.Series(lowest).groupby(own // (2 * HALF_LEVELS * BLOCK**3)).median()
    return medians.reindex(columns).to_numpy(np.float64, copy=True)


@inner
def _column_at(keys, i, j):
    """Where a column is among those of tiles, whose `keys` ascend; -1 if in none of them."""
    key = (i // TILE + HALF_TILES) * 2 * HALF_TILES + j // TILE + HALF_TILES
    at = np.searchsorted(keys, key)
    if at == len(keys) or keys[at] != key:
        return -1
    return at * TILE**2 + i % TILE * TILE + j % TILE


@njit(cache=True, nogil=True)
def _grown(keys, lows, path):
    """Ground grown from under the vehicle's path to columns that start about as high, gaps filled.
    What a column starts with may be a roof, a branch or the upper part of a wall. `keys` are of
    tiles, ascending, `lows` their columns, shape (tiles, 16, 16); so are the heights returned, NaN
    where ground is unknown."""
    low, heights = lows.reshape(-1), np.full(lows.size, np.nan)
    queue, tail = np.empty((lows.size, 2), np.int64), 0
    for n in range(len(path)):
        i, j = math.floor(path[n, 0] / _EDGE_M), math.floor(path[n, 1] / _EDGE_M)
        at = _column_at(keys, i, j)
        if at >= 0:
            if math.isnan(heights[at]):
                queue[tail, 0], queue[tail, 1] = i, j
                tail += 1
            heights[at] = path[n, 2]
    head = 0
    while head < tail:
        i, j = queue[head]
        head += 1
        for p in range(i - _AROUND, i + _AROUND + 1):
            for q in range(j - _AROUND, j + _AROUND + 1):
                at = _column_at(keys, p, q)
                if at < 0 or math.isnan(low[at]) or not math.isnan(heights[at]):
                    continue
                balance = 0
                for a in range(-_AROUND, _AROUND + 1):
                    for b in range(-_AROUND, _AROUND + 1):
                        other = _column_at(keys, p + a, q + b)
                        if other >= 0 and not math.isnan(heights[other]):
                            rise = _STEEPEST * _EDGE_M * math.hypot(a, b) + _KERB_M
                            balance += 1 if abs(low[at] - heights[other]) <= rise else -1
                if balance > 0:
                    heights[at] = low[at]
                    queue[tail, 0], queue[tail, 1] = p, q
                    tail += 1
    for _ in range(_AROUND):
        before = heights.copy()
        for at in range(len(heights)):
            if not math.isnan(before[at]):
                continue
            key, rest = keys[at // TILE**2], at % TILE**2
            i = (key // (2 * HALF_TILES) - HALF_TILES) * TILE + rest // TILE
            j = (key % (2 * HALF_TILES) - HALF_TILES) * TILE + rest % TILE
            total = count = 0.0
            for a in (-1, 0, 1):
                for b in (-1, 0, 1):
                    other = _column_at(keys, i + a, j + b)
                    if other >= 0 and not math.isnan(before[other]):
                        total, count = total + before[other], count + 1.0
            if count > 0.0:
                heights[at] = total / count
    return heights.reshape(lows.shape)


def _above(keys: NDArray[np.int64], cells: NDArray[np.uint8], ground: Ground) -> NDArray[np.bool_]:
    """Which cells stand out of the ground."""
    place = cells_of_keys(keys)
    top = CELL_M * (place[:, 2] + cells[:, 5] / 255.0)
    column = place[:, :2] // BLOCK
    tiles, of_tile = np.unique(column // TILE, axis=0, return_inverse=True)
    unknown = np.full((TILE, TILE), -np.inf)
    known = [ground.get((int(i), int(j)), unknown) for i, j in tiles]
    heights = np.reshape(known, (-1, TILE, TILE))
    level = heights[of_tile.ravel(), column[:, 0] % TILE, column[:, 1] % TILE]
    return np.asarray(top > np.nan_to_num(level, nan=-np.inf) + CLEAR_M)


def _corners(tile: tuple[int, int], ground: Ground) -> NDArray[np.float64]:
    """Heights at the corners of the patches of a tile: means of the columns there, (9, 9)."""
    i, j = tile
    empty, wide = np.full((TILE, TILE), np.nan), TILE // PATCHES
    near = [[ground.get((i + a, j + b), empty) for b in (-1, 0, 1)] for a in (-1, 0, 1)]
    around: NDArray[np.float64] = np.block(near)[TILE - 1 :, TILE - 1 :][: TILE + 2, : TILE + 2]
    four = [around[a::wide, b::wide][: PATCHES + 1, : PATCHES + 1] for a in (0, 1) for b in (0, 1)]
    number = np.isfinite(four).sum(axis=0)
    total = np.nansum(four, axis=0)
    return np.asarray(np.divide(total, number, out=np.full(total.shape, np.nan), where=number > 0))

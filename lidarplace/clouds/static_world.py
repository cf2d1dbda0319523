"""Stop rays at the static world of a log: its cells, and ground that is not flat.

A ray is followed from column to column of blocks of cells and of the ground, which is bilinear. The
result is that of testing every ray against every cell and every patch of ground.

A cell that stops a share of the rays stops a ray by chance: a hash of cell and ray, so that it is
the same whenever the ray is cast."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.clouds.convex import span
from lidarplace.clouds.hashed import uniform
from lidarplace.clouds.raycast import EVERYWHERE, GROUND, HAIR, NO_ENDS, Hits, along, cast, rays_of
from lidarplace.clouds.shapes import WORLD, Parts
from lidarplace.logs.world import (
    BLOCK,
    CELL_M,
    HALF_LEVELS,
    HALF_TILES,
    PATCH_M,
    PATCHES,
    TILE,
    StaticWorld,
    cells_of_keys,
)
from lidarplace.mounting.housing import turned
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount

_EDGE = BLOCK * CELL_M
_COLUMNS = TILE * TILE
_IN_BLOCK = BLOCK**3
_LEVELS = 2 * HALF_LEVELS
_SUNK_M = 1e-6
"""How far a ray may be under a patch where it comes in: rounding at the seam to its neighbour."""


class Worlds(NamedTuple):
    """Worlds of several scenes, as compiled code takes them; lengths in metres from the origins.

    Attributes:
        origins: of each scene, shape (S, 3), float64.
        grids: first tile i and j, their numbers, and where they start in `tile_of`, shape (S, 5).
        tile_of: row of each tile of the grids, -1 where there is none, int32.
        heights: of the ground of each tile, NaN where unknown, shape (T, 9, 9), float32.
        bounds: lowest and highest of what is in each column of each tile, shape (T * 256, 2).
        first_block: of each column of each tile, shape (T * 256 + 1,), int64.
        block_keys: `cell_keys` without the place in the block, shape (B,), int64.
        block_boxes: corner of the block, and the box that holds its cells, shape (B, 9), float64.
        masks: which of its cells are there, shape (B, 8), uint64.
        first_cell: before each word of its mask, shape (B, 8), int64.
        cells: as of `StaticWorld`, shape (n, 8), uint8."""

    origins: NDArray[np.float64]
    grids: NDArray[np.int64]
    tile_of: NDArray[np.int32]
    heights: NDArray[np.float32]
    bounds: NDArray[np.float64]
    first_block: NDArray[np.int64]
    block_keys: NDArray[np.int64]
    block_boxes: NDArray[np.float64]
    masks: NDArray[np.uint64]
    first_cell: NDArray[np.int64]
    cells: NDArray[np.uint8]


class WorldAround(NamedTuple):
    """The world in one frame: those of all scenes, which of them, and turn (3, 3) and shift (3,)
    from the ego frame to metres from the origin of the scene."""

    worlds: Worlds
    scene: int
    turn: NDArray[np.float64]
    shift: NDArray[np.float64]


def cast_in_world(
    mount: Mount,
    lidar: Lidar,
    parts: Parts,
    world: WorldAround | None,
    crop: Sequence[float] = EVERYWHERE,
    into: Hits | None = None,
    ends: NDArray[np.float64] = NO_ENDS,
    only_objects: bool = False,
    level: bool = True,
) -> Hits:
    """Cast all rays of one LiDAR at parts and the static world, None being none, see `cast`.

    `only_objects`: the world stops only rays that hit an object. `level`: whether the ground is
    flat, at z = 0, where the world has none."""
    hits = cast(mount, lidar, parts, crop, into, ends, level=level and world is None)
    if world is None:
        return hits
    region = np.array(crop, np.float64)
    for rays, numbers in rays_of(mount, lidar):
        stop_at_world(*rays, *world, region, only_objects, level, hits.of(numbers))
    return hits


def worlds_of(worlds: Mapping[str, StaticWorld]) -> Worlds:
    """Join the worlds of scenes, in their order."""
    grids, tiles_of, heights, tile_keys, blocks = [], [], [], [], []
    number = start = 0
    for world in worlds.values():
        block_keys = world.keys // _IN_BLOCK
        of_cells = np.unique(world.keys // (_IN_BLOCK * _LEVELS * _COLUMNS))
        i, j = world.tiles.astype(np.int64).T + HALF_TILES
        of_ground = i * 2 * HALF_TILES + j
        tiles = np.union1d(of_cells, of_ground)
        i, j = tiles // (2 * HALF_TILES) - HALF_TILES, tiles % (2 * HALF_TILES) - HALF_TILES
        low = [int(a.min(initial=0 if not len(a) else a[0])) for a in (i, j)]
        ni, nj = (int(a.max(initial=b)) - b + 1 for a, b in zip((i, j), low, strict=True))
        grids.append((*low, ni, nj, start))
        start += ni * nj
        grid = np.full((ni, nj), -1, np.int32)
        grid[i - low[0], j - low[1]] = number + np.arange(len(tiles))
        tiles_of.append(grid.ravel())
        own = np.full((len(tiles), PATCHES + 1, PATCHES + 1), np.nan, np.float32)
        own[np.searchsorted(tiles, of_ground)] = world.heights
        heights.append(own)
        # Columns are numbered through all tiles of all scenes.
        tile, rest = np.divmod(block_keys // _LEVELS, _COLUMNS)
        blocks.append((number + np.searchsorted(tiles, tile)) * _COLUMNS + rest)
        tile_keys.append(block_keys)
        number += len(tiles)
    columns = np.concatenate([np.empty(0, np.int64), *blocks])
    keys = np.concatenate([np.empty(0, np.int64), *tile_keys])
    cells = np.concatenate([np.empty((0, 8), np.uint8), *(w.cells for w in worlds.values())])
    places = [cells_of_keys(world.keys) for world in worlds.values()]
    place = np.concatenate([np.empty((0, 3), np.int64), *places])
    new = np.ones(len(keys), bool)
    new[1:] = (np.diff(columns) != 0) | (np.diff(keys) != 0)
    first = np.flatnonzero(new)
    masks, first_cell, boxes = _blocks(place, cells, np.append(first, len(keys)))
    ground = np.concatenate([np.empty((0, PATCHES + 1, PATCHES + 1), np.float32), *heights])
    return Worlds(
        origins=np.array([world.origin for world in worlds.values()]).reshape(-1, 3),
        grids=np.array(grids, np.int64).reshape(-1, 5),
        tile_of=np.concatenate([np.empty(0, np.int32), *tiles_of]),
        heights=ground,
        bounds=_bounds(ground, columns[first], boxes),
        first_block=np.searchsorted(columns[first], np.arange(number * _COLUMNS + 1)),
        block_keys=keys[first],
        block_boxes=boxes,
        masks=masks,
        first_cell=first_cell,
        cells=cells,
    )


def _bounds(
    ground: NDArray[np.float32], columns: NDArray[np.int64], boxes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """As of `Worlds`; `columns` and `boxes` are of its blocks."""
    ends = [slice(0, PATCHES), slice(1, PATCHES + 1)]
    patches = np.array([ground[:, a, b] for a in ends for b in ends], np.float64)
    corners = np.kron(patches, np.ones((2, 2))).reshape(4, -1)  # of the columns of each patch
    bounds = np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)
    bounds[np.isnan(bounds[:, 0])] = np.inf, -np.inf
    np.minimum.at(bounds[:, 0], columns, boxes[:, 5])
    np.maximum.at(bounds[:, 1], columns, boxes[:, 8])
    return bounds + 2 * _SUNK_M * np.array([-1.0, 1.0])


@njit(cache=True, nogil=True)
def _blocks(place, cells, edges):
    """Masks, first cells and boxes of blocks, whose cells are from one of `edges` to the next."""
    number = len(edges) - 1
    masks, first_cell = np.zeros((number, BLOCK), np.uint64), np.zeros((number, BLOCK), np.int64)
    boxes = np.empty((number, 9))
    for b in range(number):
        boxes[b, 3:6], boxes[b, 6:] = np.inf, -np.inf
        for axis in range(3):
            boxes[b, axis] = (place[edges[b], axis] // BLOCK) * BLOCK * CELL_M
        for n in range(edges[b], edges[b + 1]):
            word, bit = place[n, 0] % BLOCK, place[n, 1] % BLOCK * BLOCK + place[n, 2] % BLOCK
            masks[b, word] |= np.uint64(1) << np.uint64(bit)
            for axis in range(3):
                low, high = cells[n, axis] / 255.0, cells[n, axis + 3] / 255.0
                boxes[b, axis + 3] = min(boxes[b, axis + 3], (place[n, axis] + low) * CELL_M)
                boxes[b, axis + 6] = max(boxes[b, axis + 6], (place[n, axis] + high) * CELL_M)
        count = edges[b]
        for word in range(BLOCK):
            first_cell[b, word] = count
            count += _ones(masks[b, word])
    return masks, first_cell, boxes


@inner
def _ones(word):
    """Number of bits of a word that are set."""
    word -= (word >> np.uint64(1)) & np.uint64(0x5555555555555555)
    word = (word & np.uint64(0x3333333333333333)) + (
        (word >> np.uint64(2)) & np.uint64(0x3333333333333333)
    )
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))


@inner
def stops(share, key, ray):
    """Whether a cell that stops a share of rays, in 1/255, stops this one."""
    if share == 255:
        return True
    return 255.0 * uniform(np.uint64(key) * np.uint64(0xD1342543DE82EF95), np.uint64(ray)) < share


@inner
def _meet_block(ox, oy, oz, dx, dy, dz, b, most, ray, worlds):
    """Distance at which a ray meets a cell of a block, at most `most`, and the cell; or inf, -1.
    Cells follow each other along the ray, so the first that is met is the nearest."""
    box = worlds.block_boxes[b]
    x0, x1 = span(ox, dx, box[3], box[6])
    y0, y1 = span(oy, dy, box[4], box[7])
    z0, z1 = span(oz, dz, box[5], box[8])
    start, end = max(x0, y0, z0, 0.0), min(x1, y1, z1, most)
    if start > end:
        return np.inf, -1
    # In cells from the corner of the block.
    x, y, z = (ox - box[0]) / CELL_M, (oy - box[1]) / CELL_M, (oz - box[2]) / CELL_M
    vx, vy, vz = dx / CELL_M, dy / CELL_M, dz / CELL_M
    i = min(max(math.floor(x + start * vx), 0), BLOCK - 1)
    j = min(max(math.floor(y + start * vy), 0), BLOCK - 1)
    k = min(max(math.floor(z + start * vz), 0), BLOCK - 1)
    si, sj, sk = 1 if vx > 0.0 else -1, 1 if vy > 0.0 else -1, 1 if vz > 0.0 else -1
    ti = (i + (si > 0) - x) / vx if vx != 0.0 else np.inf
    tj = (j + (sj > 0) - y) / vy if vy != 0.0 else np.inf
    tk = (k + (sk > 0) - z) / vz if vz != 0.0 else np.inf
    wi = abs(1.0 / vx) if vx != 0.0 else np.inf
    wj = abs(1.0 / vy) if vy != 0.0 else np.inf
    wk = abs(1.0 / vz) if vz != 0.0 else np.inf
    while True:
        mask = worlds.masks[b, i]
        bit = np.uint64(1) << np.uint64(j * BLOCK + k)
        if mask & bit:
            cell = worlds.first_cell[b, i] + _ones(mask & (bit - np.uint64(1)))
            own = worlds.cells[cell]
            x0, x1 = span(x - i, vx, own[0] / 255.0, own[3] / 255.0)
            y0, y1 = span(y - j, vy, own[1] / 255.0, own[4] / 255.0)
            z0, z1 = span(z - k, vz, own[2] / 255.0, own[5] / 255.0)
            near = max(x0, y0, z0)
            key = worlds.block_keys[b] * 512 + (i * BLOCK + j) * BLOCK + k
            if 0.0 < near <= min(x1, y1, z1, most) and stops(own[6], key, ray):
                return near, cell
        if min(ti, tj, tk) > end:
            return np.inf, -1
        if ti <= tj and ti <= tk:
            i, ti = i + si, ti + wi
        elif tj <= tk:
            j, tj = j + sj, tj + wj
        else:
            k, tk = k + sk, tk + wk
        if min(i, j, k) < 0 or max(i, j, k) >= BLOCK:
            return np.inf, -1


@inner
def _meet_patch(ox, oy, oz, dx, dy, dz, patch, most):
    """Distance at which a ray comes down to a patch of ground, at most `most`, or inf.

    `patch`: x and y of its corner, heights there, further along y, along x, and along both."""
    x0, x1 = span(ox, dx, patch[0], patch[0] + PATCH_M)
    y0, y1 = span(oy, dy, patch[1], patch[1] + PATCH_M)
    start, end = max(x0, y0, 0.0), min(x1, y1, most)
    if start > end:
        return np.inf
    u, v = (ox + start * dx - patch[0]) / PATCH_M, (oy + start * dy - patch[1]) / PATCH_M
    du, dv = dx / PATCH_M, dy / PATCH_M
    along_u, along_v = patch[4] - patch[2], patch[3] - patch[2]
    both = patch[5] - patch[4] - along_v
    # Height above the patch, at `start` and beyond: c + b t + a t².
    c = oz + start * dz - (patch[2] + along_u * u + along_v * v + both * u * v)
    b = dz - (along_u * du + along_v * dv + both * (u * dv + v * du))
    a = -both * du * dv
    if c <= 0.0:
        return start if c >= -_SUNK_M and start > 0.0 else np.inf
    root = b * b - 4.0 * a * c
    if root < 0.0 or (b >= 0.0 and a >= 0.0):
        return np.inf
    # The smaller positive root, without cancellation.
    q = math.sqrt(root)
    t = 2.0 * c / (q - b) if b <= 0.0 else (b + q) / (-2.0 * a)
    return start + t if start + t <= end else np.inf


@inner
def _slope(x, y, dx, dy, dz, patch):
    """Cosine of incidence on a patch at (x, y)."""
    u, v = (x - patch[0]) / PATCH_M, (y - patch[1]) / PATCH_M
    both = patch[5] - patch[4] - patch[3] + patch[2]
    hx = (patch[4] - patch[2] + both * v) / PATCH_M
    hy = (patch[3] - patch[2] + both * u) / PATCH_M
    return min(max((hx * dx + hy * dy - dz) / math.sqrt(1.0 + hx * hx + hy * hy), 0.0), 1.0)


@inner
def _tile_at(worlds, scene, i, j):
    """Row of the tile that holds the column (i, j), -1 if there is none."""
    grids = worlds.grids
    ti, tj = i // TILE - grids[scene, 0], j // TILE - grids[scene, 1]
    if ti < 0 or tj < 0 or ti >= grids[scene, 2] or tj >= grids[scene, 3]:
        return -1
    return worlds.tile_of[grids[scene, 4] + ti * grids[scene, 3] + tj]


@inner
def _fill_patch(worlds, tile, i, j, patch):
    """Fill `patch` with that below the column (i, j), see `_meet_patch`; return whether its ground
    is known."""
    heights, p, q = worlds.heights, i % TILE // 2, j % TILE // 2
    patch[0], patch[1] = i // 2 * PATCH_M, j // 2 * PATCH_M
    patch[2], patch[3] = heights[tile, p, q], heights[tile, p, q + 1]
    patch[4], patch[5] = heights[tile, p + 1, q], heights[tile, p + 1, q + 1]
    return not math.isnan(patch[2] + patch[3] + patch[4] + patch[5])


@inner
def first_met(ox, oy, oz, dx, dy, dz, most, ray, worlds, scene, patch):
    """Distance at which a ray meets the world first, and the cell, -1 for ground; `most` if it
    meets nothing nearer: from column to column. Start and direction are in the axes of the world,
    metres from its origin; `patch`, shape (6,), becomes that of the ground."""
    i, j = math.floor(ox / _EDGE), math.floor(oy / _EDGE)
    si, sj = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1
    ti = ((i + (si > 0)) * _EDGE - ox) / dx if dx != 0.0 else np.inf
    tj = ((j + (sj > 0)) * _EDGE - oy) / dy if dy != 0.0 else np.inf
    t = 0.0
    while t < most:
        tile = _tile_at(worlds, scene, i, j)
        at = tile * _COLUMNS + i % TILE * TILE + j % TILE
        leave = min(ti, tj, most)
        low, high = min(oz + t * dz, oz + leave * dz), max(oz + t * dz, oz + leave * dz)
        if tile >= 0 and low <= worlds.bounds[at, 1] and high >= worlds.bounds[at, 0]:
            nearest, cell = most, -1
            if _fill_patch(worlds, tile, i, j, patch) and low <= max(
                patch[2], patch[3], patch[4], patch[5]
            ):
                nearest = min(_meet_patch(ox, oy, oz, dx, dy, dz, patch, leave), most)
            for block in range(worlds.first_block[at], worlds.first_block[at + 1]):
                if worlds.block_boxes[block, 5] > high or worlds.block_boxes[block, 8] < low:
                    continue
                near, own = _meet_block(ox, oy, oz, dx, dy, dz, block, nearest, ray, worlds)
                if near < nearest:
                    nearest, cell = near, own
            if nearest < most:
                return nearest, cell
        t = min(ti, tj)
        if ti <= tj:
            i, ti = i + si, ti + abs(_EDGE / dx)
        else:
            j, tj = j + sj, tj + abs(_EDGE / dy)
    return most, -1


@njit(cache=True, nogil=True, error_model="numpy")
def stop_at_world(
    place, turn_in_ego, fired, worlds, scene, turn, shift, crop, only_objects, level, hits
):
    """Let rays end at the world, in place, where that is nearer than what they hit.

    `place` and `turn_in_ego` are position and rotation of the sensor in the ego frame, `hits` of
    the `Beams` that are fired, without ground; `worlds` to `shift` as of `WorldAround`, `crop` as
    of `cast`, `only_objects` as of `cast_in_world`. `level`: where no ground is known it is flat,
    as seen from the vehicle."""
    ox, oy, oz = turn @ place + shift
    rotation, patch = turn @ turn_in_ego, np.empty(6)
    ranges, targets, reflected = hits
    steps = fired.azimuths.shape[2]
    for beam in range(len(fired.elevations)):
        _, ce, se = fired.elevations[beam]
        cosines, sines = along(fired, beam)
        for step in range(steps):
            ray = beam * steps + step
            if only_objects and targets[ray] < 0:
                continue
            x, y = ce * cosines[step], ce * sines[step]
            dx, dy, dz = turned(rotation, x, y, se)
            way = turned(turn_in_ego, x, y, se)
            most = min(ranges[ray], fired.reach)
            if level and -way[2] * most > place[2] > 0.0:
                t = -place[2] / way[2]
                i, j = math.floor((ox + t * dx) / _EDGE), math.floor((oy + t * dy) / _EDGE)
                tile = _tile_at(worlds, scene, i, j)
                if tile < 0 or not _fill_patch(worlds, tile, i, j, patch):
                    ranges[ray], targets[ray], reflected[ray], most = t, GROUND, -way[2], t
            for axis in range(3):  # beyond the crop, and rounding, all may stay as it is
                _, leave = span(place[axis], way[axis], crop[axis], crop[axis + 3])
                most = min(most, leave + HAIR)
            t, cell = first_met(ox, oy, oz, dx, dy, dz, most, ray, worlds, scene, patch)
            if t >= most:
                continue
            ranges[ray] = t
            if cell < 0:
                slope = _slope(ox + t * dx, oy + t * dy, dx, dy, dz, patch)
                targets[ray], reflected[ray] = GROUND, slope
            else:
                targets[ray], reflected[ray] = WORLD, worlds.cells[cell, 7] / 255.0

"""Stop rays at the static world of a log: its cells, and ground that is not flat.

`stop_at_world` follows each ray up to what it hits, or to the end of the crop (`first_met`):

1. from column to column, of which most are empty where the ray passes;
2. down to the ground of a column, which is bilinear (`_meet_patch`);
3. through the blocks of a column, from cell to cell (`_meet_block`).

The result is that of testing every ray against every cell and every patch of ground.

A cell that stops a share of the rays stops a ray by chance: a hash of cell and ray, so that it is
the same whenever the ray is cast."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inlined, inner, njit
from lidarplace.clouds.convex import span
from lidarplace.clouds.hashed import uniform
from lidarplace.clouds.raycast import EVERYWHERE, GROUND, HAIR, NO_ENDS, Hits, along, cast, rays_of
from lidarplace.clouds.shapes import WORLD, Parts
from lidarplace.clouds.worlds import COLUMNS, SUNK_M, WorldAround, bit_count
from lidarplace.logs.world import BLOCK, CELL_M, PATCH_M, TILE
from lidarplace.mounting.housing import turned
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount

_EDGE = BLOCK * CELL_M


def cast_in_world(
    mount: Mount,
    lidar: Lidar,
    parts: Parts,
    world: WorldAround | None,
    crop: Sequence[float] = EVERYWHERE,
    into: Hits | None = None,
    ends: NDArray[np.float64] = NO_ENDS,
) -> Hits:
    """Cast all rays of one LiDAR at parts and the static world, None being none, see `cast`."""
    hits = cast(mount, lidar, parts, crop, into, ends, level=world is None)
    if world is not None:
        stop_in_world(mount, lidar, hits, world, crop)
    return hits


def stop_in_world(
    mount: Mount,
    lidar: Lidar,
    hits: Hits,
    world: WorldAround,
    crop: Sequence[float] = EVERYWHERE,
    only_objects: bool = False,
    level: bool = True,
) -> None:
    """Let the rays of `hits`, which were cast without ground, end at the static world, in place.

    `only_objects`: only rays that hit an object. `level`: whether the ground is flat, at z = 0,
    where the world has none."""
    region = np.array(crop, np.float64)
    for rays, numbers in rays_of(mount, lidar):
        stop_at_world(rays, world, region, only_objects, level, hits.of(numbers))


@inner
def stops(share, key, ray):
    """Return whether a cell that stops a share of rays, in 1/255, stops this one."""
    if share == 255:
        return True
    return 255.0 * uniform(np.uint64(key) * np.uint64(0xD1342543DE82EF95), np.uint64(ray)) < share


@njit(cache=True, nogil=True, error_model="numpy")
def stop_at_world(rays, around, crop, only_objects, level, hits):
    """Let rays end at the world, in place, where that is nearer than what they hit.

    `hits` are those of `Rays` without ground, `around` is a `WorldAround`, `crop` as of `cast`,
    `only_objects` as of `stop_in_world`. `level`: where no ground is known it is flat, as seen from
    the vehicle."""
    (origin, rotation_in_ego, beams), (worlds, scene, turn, shift) = rays, around
    x, y, z = turn @ origin + shift
    start, rotation = (x, y, z), turn @ rotation_in_ego
    ranges, targets, reflected = hits
    steps = beams.azimuths.shape[2]
    for beam in range(len(beams.elevations)):
        _, ce, se = beams.elevations[beam]
        cosines, sines = along(beams, beam)
        for step in range(steps):
            ray = beam * steps + step
            if only_objects and targets[ray] < 0:
                continue
            x, y = ce * cosines[step], ce * sines[step]
            way, way_in_ego = turned(rotation, x, y, se), turned(rotation_in_ego, x, y, se)
            most = min(ranges[ray], beams.reach)
            if level and -way_in_ego[2] * most > origin[2] > 0.0:
                t = -origin[2] / way_in_ego[2]
                x, y = start[0] + t * way[0], start[1] + t * way[1]
                if not _ground_is_known(worlds, scene, x, y):
                    ranges[ray], targets[ray], reflected[ray] = t, GROUND, -way_in_ego[2]
                    most = t
            most = _end_in_crop(origin, way_in_ego, crop, most)
            t, cell, patch = first_met(start, way, most, ray, worlds, scene)
            if t >= most:
                continue
            ranges[ray] = t
            if cell < 0:
                x, y = start[0] + t * way[0], start[1] + t * way[1]
                targets[ray], reflected[ray] = GROUND, _cosine_on_patch(x, y, way, patch)
            else:
                targets[ray], reflected[ray] = WORLD, worlds.cells[cell, 7] / 255.0


@inlined
def _ground_is_known(worlds, scene, x, y):
    """Return whether the world has ground below a place, metres from its origin."""
    i, j = math.floor(x / _EDGE), math.floor(y / _EDGE)
    tile = _tile_at(worlds, scene, i, j)
    return tile >= 0 and _is_known(_patch_below(worlds.heights, tile, i, j))


@inlined
def _end_in_crop(origin, way, crop, most):
    """Return where a ray leaves the crop, and rounding, at most `most`: beyond all may stay."""
    for axis in range(3):
        _, leave = span(origin[axis], way[axis], crop[axis], crop[axis + 3])
        most = min(most, leave + HAIR)
    return most


@inner
def first_met(start, way, most, ray, worlds, scene):
    """Return where a ray meets the world first, the cell, -1 for ground, and the patch of ground.

    The distance is `most` if it meets nothing nearer. Start and direction are in the axes of the
    world, metres from its origin. The ray goes from column to column."""
    (ox, oy, oz), (dx, dy, dz) = start, way
    i, j = math.floor(ox / _EDGE), math.floor(oy / _EDGE)
    si, sj = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1
    ti = ((i + (si > 0)) * _EDGE - ox) / dx if dx != 0.0 else np.inf
    tj = ((j + (sj > 0)) * _EDGE - oy) / dy if dy != 0.0 else np.inf
    t = 0.0
    patch = _NO_PATCH
    while t < most:
        tile = _tile_at(worlds, scene, i, j)
        column = tile * COLUMNS + i % TILE * TILE + j % TILE
        leave = min(ti, tj, most)
        low, high = min(oz + t * dz, oz + leave * dz), max(oz + t * dz, oz + leave * dz)
        if tile >= 0 and low <= worlds.bounds[column, 1] and high >= worlds.bounds[column, 0]:
            nearest, cell = most, -1
            patch = _patch_below(worlds.heights, tile, i, j)
            if _is_known(patch) and low <= max(patch.h00, patch.h01, patch.h10, patch.h11):
                nearest = min(_meet_patch(start, way, patch, leave), most)
            for block in range(worlds.first_block[column], worlds.first_block[column + 1]):
                if worlds.block_boxes[block, 5] > high or worlds.block_boxes[block, 8] < low:
                    continue
                near, met = _meet_block(start, way, block, nearest, ray, worlds)
                if near < nearest:
                    nearest, cell = near, met
            if nearest < most:
                return nearest, cell, patch
        t = min(ti, tj)
        if ti <= tj:
            i, ti = i + si, ti + abs(_EDGE / dx)
        else:
            j, tj = j + sj, tj + abs(_EDGE / dy)
    return most, -1, patch


@inlined
def _tile_at(worlds, scene, i, j):
    """Return the row of the tile that holds the column (i, j), -1 if there is none."""
    grids = worlds.grids
    ti, tj = i // TILE - grids[scene, 0], j // TILE - grids[scene, 1]
    if ti < 0 or tj < 0 or ti >= grids[scene, 2] or tj >= grids[scene, 3]:
        return -1
    return worlds.tile_of[grids[scene, 4] + ti * grids[scene, 3] + tj]


class _Patch(NamedTuple):
    """A patch of ground: x and y of its corner, heights there, further along y, x, and both."""

    x: float
    y: float
    h00: float
    h01: float
    h10: float
    h11: float


_NO_PATCH = _Patch(*[math.nan] * 6)


@inlined
def _patch_below(heights, tile, i, j):
    """Return the patch below the column (i, j), NaN where its ground is unknown."""
    p, q = i % TILE // 2, j % TILE // 2
    near = np.float64(heights[tile, p, q]), np.float64(heights[tile, p, q + 1])
    far = np.float64(heights[tile, p + 1, q]), np.float64(heights[tile, p + 1, q + 1])
    return _Patch(i // 2 * PATCH_M, j // 2 * PATCH_M, *near, *far)


@inlined
def _is_known(patch):
    return not math.isnan(patch.h00 + patch.h01 + patch.h10 + patch.h11)


@inlined
def _meet_patch(start, way, patch, most):
    """Return where a ray comes down to a patch of ground, at most `most`, or inf."""
    (ox, oy, oz), (dx, dy, dz) = start, way
    x0, x1 = span(ox, dx, patch.x, patch.x + PATCH_M)
    y0, y1 = span(oy, dy, patch.y, patch.y + PATCH_M)
    near, far = max(x0, y0, 0.0), min(x1, y1, most)
    if near > far:
        return np.inf
    u, v = (ox + near * dx - patch.x) / PATCH_M, (oy + near * dy - patch.y) / PATCH_M
    du, dv = dx / PATCH_M, dy / PATCH_M
    along_u, along_v = patch.h10 - patch.h00, patch.h01 - patch.h00
    both = patch.h11 - patch.h10 - along_v
    # Height above the patch, at `near` and beyond: c + b t + a t².
    c = oz + near * dz - (patch.h00 + along_u * u + along_v * v + both * u * v)
    b = dz - (along_u * du + along_v * dv + both * (u * dv + v * du))
    a = -both * du * dv
    if c <= 0.0:
        return near if c >= -SUNK_M and near > 0.0 else np.inf
    root = b * b - 4.0 * a * c
    if root < 0.0 or (b >= 0.0 and a >= 0.0):
        return np.inf
    # The smaller positive root, without cancellation.
    q = math.sqrt(root)
    t = 2.0 * c / (q - b) if b <= 0.0 else (b + q) / (-2.0 * a)
    return near + t if near + t <= far else np.inf


@inlined
def _cosine_on_patch(x, y, way, patch):
    """Return the cosine of incidence on a patch at (x, y)."""
    u, v = (x - patch.x) / PATCH_M, (y - patch.y) / PATCH_M
    both = patch.h11 - patch.h10 - patch.h01 + patch.h00
    hx = (patch.h10 - patch.h00 + both * v) / PATCH_M
    hy = (patch.h01 - patch.h00 + both * u) / PATCH_M
    down = hx * way[0] + hy * way[1] - way[2]
    return min(max(down / math.sqrt(1.0 + hx * hx + hy * hy), 0.0), 1.0)


@inlined
def _meet_block(start, way, block, most, ray, worlds):
    """Return where a ray meets a cell of a block, at most `most`, and the cell; or inf, -1.

    Cells follow each other along the ray, so the first that is met is the nearest."""
    (ox, oy, oz), (dx, dy, dz), box = start, way, worlds.block_boxes[block]
    x0, x1 = span(ox, dx, box[3], box[6])
    y0, y1 = span(oy, dy, box[4], box[7])
    z0, z1 = span(oz, dz, box[5], box[8])
    near, far = max(x0, y0, z0, 0.0), min(x1, y1, z1, most)
    if near > far:
        return np.inf, -1
    # In cells from the corner of the block.
    x, y, z = (ox - box[0]) / CELL_M, (oy - box[1]) / CELL_M, (oz - box[2]) / CELL_M
    vx, vy, vz = dx / CELL_M, dy / CELL_M, dz / CELL_M
    i, ti, si, wi = _first_in_block(x, vx, near)
    j, tj, sj, wj = _first_in_block(y, vy, near)
    k, tk, sk, wk = _first_in_block(z, vz, near)
    while True:
        mask = worlds.masks[block, i]
        bit = np.uint64(1) << np.uint64(j * BLOCK + k)
        if mask & bit:
            cell = worlds.first_cell[block, i] + bit_count(mask & (bit - np.uint64(1)))
            ends = worlds.cells[cell]
            x0, x1 = span(x - i, vx, ends[0] / 255.0, ends[3] / 255.0)
            y0, y1 = span(y - j, vy, ends[1] / 255.0, ends[4] / 255.0)
            z0, z1 = span(z - k, vz, ends[2] / 255.0, ends[5] / 255.0)
            enter = max(x0, y0, z0)
            key = worlds.block_keys[block] * 512 + (i * BLOCK + j) * BLOCK + k
            if 0.0 < enter <= min(x1, y1, z1, most) and stops(ends[6], key, ray):
                return enter, cell
        if min(ti, tj, tk) > far:
            return np.inf, -1
        if ti <= tj and ti <= tk:
            i, ti = i + si, ti + wi
        elif tj <= tk:
            j, tj = j + sj, tj + wj
        else:
            k, tk = k + sk, tk + wk
        if min(i, j, k) < 0 or max(i, j, k) >= BLOCK:
            return np.inf, -1


@inlined
def _first_in_block(x, v, near):
    """Return the cell that a ray enters, where it leaves it, its next cell, and the length of one.

    `x` and `v` are start and direction along an axis, in cells from the corner of the block."""
    i = min(max(math.floor(x + near * v), 0), BLOCK - 1)
    up = 1 if v > 0.0 else -1
    leave = (i + (up > 0) - x) / v if v != 0.0 else np.inf
    return i, leave, up, abs(1.0 / v) if v != 0.0 else np.inf

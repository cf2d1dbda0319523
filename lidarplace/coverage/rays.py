"""Voxels and single rays: coverage, the number of rays, and the chance to be detected."""

import math
from collections.abc import Iterator
from functools import cache
from itertools import chain, starmap
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import njit
from lidarplace.base.roi import Roi
from lidarplace.coverage.bresenham import walk_bresenham
from lidarplace.coverage.dda import walk_dda
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement, blocks

RayMethod = Literal["dda", "bresenham"]
_CHUNK = 2**16  # voxels listed before they are used: 256 kB, which stays in a core's own cache


class VoxelGrid(NamedTuple):
    """The voxels, as compiled code takes them.

    Attributes:
        minimum, resolution: lower corner, ego frame, shape (3,), and edge of a voxel, metres.
        shape: voxels along the axes, int64, shape (3,).
        strides: voxel (i, j, k) has the index `i * strides[0] + j * strides[1] + k * strides[2]`.
    """

    minimum: NDArray[np.float64]
    resolution: float
    shape: NDArray[np.int64]
    strides: NDArray[np.int64]


class VoxelLists(NamedTuple):
    """Voxels of rays: ray n passes `voxels[offsets[n]:offsets[n + 1]]`, indices in a grid."""

    voxels: NDArray[np.unsignedinteger]
    offsets: NDArray[np.int64]


def covered_by_rays(placement: Placement, roi: Roi, method: RayMethod) -> NDArray[np.bool_]:
    """Return the voxels that at least one ray of `placement` passes, shape (nx, ny, nz)."""
    covered = _in_layers(roi, np.bool_)
    for voxels, _ in _chunks(placement, roi, method):
        _cover(voxels, covered.reshape(-1))
    return np.ascontiguousarray(covered.transpose(1, 2, 0))


def ray_counts(
    placement: Placement, roi: Roi, method: RayMethod, azimuth_stride: int = 1
) -> NDArray[np.int32]:
    """Return m(v), the number of rays through every voxel, shape (nx, ny, nz), not in C order.

    With `azimuth_stride` rays are `thinned`; each stands for `ray_weight` of them."""
    counts = _in_layers(roi, np.int32)
    for voxels, _ in _chunks(thinned(placement, azimuth_stride), roi, method):
        _count(voxels, counts.reshape(-1))
    return counts.transpose(1, 2, 0)


def log_miss(
    placement: Placement,
    roi: Roi,
    method: RayMethod,
    counts: NDArray[np.int32],
    frames: int,
    detection_probability: float,
    azimuth_stride: int = 1,
) -> NDArray[np.float64]:
    """Return `ln prod over rays of (1 - q w_r)`: the log-probability that no ray detects an object.

    Ray r reaches voxel v with probability `w_r = prod (1 - p)` over the voxels before v. Shape (nx,
    ny, nz), <= 0; 0 where p = 0. With `azimuth_stride` rays are `thinned`, and each counts
    `ray_weight` times.

    `counts`, shape (nx, ny, nz), are the frames, of `frames`, in which each voxel is occupied: from
    integers 1 - p is as exact as p. `detection_probability` is q, in (0, 1]."""
    layers = np.ascontiguousarray(counts.transpose(2, 0, 1)).reshape(-1)
    result = _in_layers(roi, np.float64)
    for voxels, offsets in _chunks(thinned(placement, azimuth_stride), roi, method):
        _add_log_miss(voxels, offsets, layers, frames, detection_probability, result.reshape(-1))
    result *= ray_weight(placement, azimuth_stride)
    return result.transpose(1, 2, 0)


def thinned(placement: Placement, azimuth_stride: int) -> Placement:
    """Return every LiDAR with `round(azimuth_steps / azimuth_stride)` azimuth steps, at least one.

    A pattern gets as many rays.

    Raises ValueError if the stride is below 1, or none of the steps is in the field of view."""
    if azimuth_stride < 1:
        raise InputError(key="azimuth_stride", expected="at least 1", found=azimuth_stride)
    return placement.each_lidar(lambda lidar: lidar.thinned(1 / azimuth_stride))


def ray_weight(placement: Placement, azimuth_stride: int) -> float:
    """Return the rays of `placement` that one of `thinned(placement, azimuth_stride)` stands for.

    It is by the steps of whole turns, so the stride itself where it divides them."""
    thin = thinned(placement, azimuth_stride)
    rigs = (placement, thin)
    every, traced = (sum(lidar.beams * lidar.azimuth_steps for lidar in rig.lidars) for rig in rigs)
    return every / traced


def _in_layers(roi: Roi, dtype: type[np.generic]) -> NDArray[Any]:
    """Return zeros by layers of z, shape (nz, nx, ny).

    Rays run flat: in C order of (nx, ny, nz) nearly each of their voxels would be on another
    page."""
    nx, ny, nz = roi.shape
    return np.zeros((nz, nx, ny), dtype)


def _chunks(placement: Placement, roi: Roi, method: RayMethod) -> Iterator[VoxelLists]:
    """Yield voxels of some rays after the other, as indices into `_in_layers`, and their offsets.

    The next chunk uses the memory again."""
    nx, ny, nz = roi.shape
    strides = np.array([ny, 1, nx * ny])
    grid = VoxelGrid(roi.minimum, roi.resolution, np.array([nx, ny, nz]), strides)
    index: type[np.unsignedinteger] = np.uint32 if nx * ny * nz < 2**32 else np.uint64
    voxels = np.empty(max(_CHUNK, 2 * (nx + ny + nz)), index)
    lists = VoxelLists(voxels, np.empty(_CHUNK // 8, np.int64))
    directions_of = cache(Lidar.directions)
    lidars = zip(placement.mounts, placement.lidars, strict=True)
    bresenham = method == "bresenham"
    for mount, lidar, _ in chain.from_iterable(starmap(blocks, lidars)):
        start, reach, ways = mount.position, lidar.reach, directions_of(lidar) @ mount.rotation.T
        spans = clip_rays(start, ways, reach, grid)
        hit = spans[:, 0] < np.inf
        ways, spans = ways[hit], spans[hit]
        while len(ways):
            rays = walk_rays(bresenham, start, ways, spans, reach, grid, lists)
            yield VoxelLists(lists.voxels[: lists.offsets[rays]], lists.offsets[: rays + 1])
            ways, spans = ways[rays:], spans[rays:]


@njit(cache=True, nogil=True, error_model="numpy")
def clip_rays(origin, directions, reach, grid):
    """Return entry (0 for an origin in the grid) and exit of rays, metres, shape (rays, 2).

    (inf, -inf) for those that miss the grid or end before it, by `reach`, metres. `origin` (3,) and
    unit vectors `directions` (rays, 3) are in the ego frame."""
    spans = np.empty((len(directions), 2))
    for r in range(len(directions)):
        near, far = 0.0, math.inf
        for a in range(3):
            low = grid.minimum[a] - origin[a]
            high = grid.minimum[a] + grid.shape[a] * grid.resolution - origin[a]
            d = directions[r, a]
            if d == 0.0:
                if low > 0 or high <= 0:  # voxels are half open
                    far = -math.inf
            else:
                t0, t1 = low / d, high / d
                near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
        hit = near <= far and far > 0 and near < reach
        spans[r, 0] = near if hit else math.inf
        spans[r, 1] = far if hit else -math.inf
    return spans


@njit(cache=True, nogil=True, error_model="numpy")
def walk_rays(bresenham, origin, directions, spans, reach, grid, lists):
    """Write the voxels of the first rays, as many as fit, to `VoxelLists`; return their number.

    `bresenham`: whether the paper's integer lines are followed. Room for `sum(grid.shape)` voxels
    is enough for a ray. The other arguments are those of `clip_rays`, which gives `spans`."""
    voxels, offsets = lists
    size, rays = np.uint64(0), 0
    room = len(voxels) - grid.shape.sum()
    offsets[0] = 0
    while rays < min(len(directions), len(offsets) - 1) and size <= room:
        near, far = spans[rays, 0], min(spans[rays, 1], reach)
        if bresenham and near < far:
            size = walk_bresenham(origin, directions[rays], far, grid, voxels, size)
        elif not bresenham and near < math.inf:
            size = walk_dda(origin, directions[rays], near, reach, grid, voxels, size)
        rays += 1
        offsets[rays] = size
    return rays


@njit(cache=True, nogil=True)
def _cover(voxels, covered):
    for v in voxels:
        covered[v] = True


@njit(cache=True, nogil=True)
def _count(voxels, counts):
    for v in voxels:
        counts[v] += 1


@njit(cache=True, nogil=True)
def _add_log_miss(voxels, offsets, counts, frames, q, result):
    for r in range(len(offsets) - 1):
        reach = 1.0
        term = math.log1p(-q) if q < 1 else -math.inf
        for v in voxels[offsets[r] : offsets[r + 1]]:
            if counts[v] > 0:
                result[v] += term
                reach *= (frames - counts[v]) / frames
                if reach == 0:
                    break
                term = math.log1p(-q * reach)

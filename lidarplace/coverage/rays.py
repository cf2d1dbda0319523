"""What single rays give a voxel: coverage, the number of rays, and the chance to be detected."""

import math
from collections.abc import Iterator
from functools import cache
from itertools import chain, starmap
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.base.roi import Roi
from lidarplace.coverage.bresenham import walk_bresenham
from lidarplace.coverage.clip import VoxelGrid, clip_rays
from lidarplace.coverage.dda import walk_dda
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement, blocks

RayMethod = Literal["dda", "bresenham"]
_CHUNK = 2**16  # voxels listed before they are used: 256 kB, which stays in a core's own cache


def covered_by_rays(placement: Placement, roi: Roi, method: RayMethod) -> NDArray[np.bool_]:
    """Voxels that at least one ray of `placement` passes, shape (nx, ny, nz)."""
    covered = _in_layers(roi, np.bool_)
    for voxels, _ in _chunks(placement, roi, method):
        _cover(voxels, covered.reshape(-1))
    return np.ascontiguousarray(_by_voxel(covered))


def ray_counts(
    placement: Placement, roi: Roi, method: RayMethod, azimuth_stride: int = 1
) -> NDArray[np.int32]:
    """m(v), the number of rays through every voxel, shape (nx, ny, nz), not in C order.

    With `azimuth_stride` the rays of fewer azimuth steps are counted, see `thinned`; each stands
    for `ray_weight` rays.
    """
    counts = _in_layers(roi, np.int32)
    thin = thinned(placement, azimuth_stride)
    for voxels, _ in _chunks(thin, roi, method):
        _count(voxels, counts.reshape(-1))
    return _by_voxel(counts)


def log_miss(
    placement: Placement,
    roi: Roi,
    method: RayMethod,
    counts: NDArray[np.int32],
    frames: int,
    detection_probability: float,
    azimuth_stride: int = 1,
) -> NDArray[np.float64]:
    """`ln prod over rays of (1 - q w_r)`: the log-probability that no ray detects an object at v.

    Ray r reaches voxel v with probability `w_r = prod (1 - p)` over the voxels before v
    (`expected_ig` with occlusion). Shape (nx, ny, nz), <= 0; 0 where p = 0, where nothing can be
    detected. With `azimuth_stride` fewer rays are traced, see `thinned`, and each counts
    `ray_weight` times.

    Args:
        counts, frames: frames in which each voxel is occupied, shape (nx, ny, nz), and T; from
            integers 1 - p is as exact as p.
        detection_probability: q, in (0, 1].
    """
    thin = thinned(placement, azimuth_stride)
    layers = np.ascontiguousarray(counts.transpose(2, 0, 1)).reshape(-1)
    result = _in_layers(roi, np.float64)
    for voxels, offsets in _chunks(thin, roi, method):
        _add_log_miss(voxels, offsets, layers, frames, detection_probability, result.reshape(-1))
    result *= ray_weight(placement, azimuth_stride)
    return _by_voxel(result)


def thinned(placement: Placement, azimuth_stride: int) -> Placement:
    """Every LiDAR with `round(azimuth_steps / azimuth_stride)` azimuth steps, at least one.

    Of a pattern, so many rays.

    Raises:
        ValueError: the stride is below 1, or none of the remaining steps is in the field of view.
    """
    if azimuth_stride < 1:
        raise ValueError(f"azimuth_stride must be at least 1, found {azimuth_stride}")
    return placement.each_lidar(lambda lidar: lidar.thinned(1 / azimuth_stride))


def ray_weight(placement: Placement, azimuth_stride: int) -> float:
    """Rays of `placement` that one of `thinned(placement, azimuth_stride)` stands for.

    By the steps of whole turns, so the stride itself where it divides them, whatever the field of
    view. The mean over the LiDARs, whose models may differ in what rounding makes of the stride.
    """
    thin = thinned(placement, azimuth_stride)
    in_turns = [
        sum(lidar.beams * lidar.azimuth_steps for lidar in rig.lidars) for rig in (placement, thin)
    ]
    return in_turns[0] / in_turns[1]


def _in_layers(roi: Roi, dtype: type[np.generic]) -> NDArray[Any]:
    """Zeros by layers of z, shape (nz, nx, ny).

    Rays run flat, so voxels that follow each other on a ray lie close together in memory. In C
    order of (nx, ny, nz) nearly each would be on a page of its own: half the time would go there.
    """
    nx, ny, nz = roi.shape
    return np.zeros((nz, nx, ny), dtype)


def _by_voxel(layers: NDArray[Any]) -> NDArray[Any]:
    """A view of layers with shape (nx, ny, nz): the order in memory stays."""
    return layers.transpose(1, 2, 0)


def _chunks(
    placement: Placement, roi: Roi, method: RayMethod
) -> Iterator[tuple[NDArray[np.unsignedinteger], NDArray[np.int64]]]:
    """Voxels of some rays after the other, as indices into `_in_layers`, and their offsets.

    All chunks share one piece of memory: use a chunk before asking for the next.
    """
    nx, ny, nz = roi.shape
    in_layers = np.array([ny, 1, nx * ny])
    grid = VoxelGrid(roi.minimum, roi.resolution, np.array([nx, ny, nz]), strides=in_layers)
    index: type[np.unsignedinteger] = np.uint32 if nx * ny * nz < 2**32 else np.uint64
    voxels = np.empty(max(_CHUNK, 2 * (nx + ny + nz)), index)
    offsets = np.empty(_CHUNK // 8, np.int64)
    directions_of = cache(Lidar.directions)
    lidars = zip(placement.mounts, placement.lidars, strict=True)
    for mount, lidar, _ in chain.from_iterable(starmap(blocks, lidars)):
        reach, directions = lidar.reach, directions_of(lidar) @ mount.rotation.T
        spans = clip_rays(mount.position, directions, reach, grid)
        hit = spans[:, 0] < np.inf
        directions, spans = directions[hit], spans[hit]
        first = 0
        while first < len(directions):
            rays = walk_rays(
                method == "bresenham",
                mount.position,
                directions[first:],
                spans[first:],
                reach,
                grid,
                voxels,
                offsets,
            )
            yield voxels[: offsets[rays]], offsets[: rays + 1]
            first += rays


@njit(cache=True, nogil=True, error_model="numpy")
def walk_rays(bresenham, origin, directions, spans, reach, grid, voxels, offsets):
    """Write the voxels of the first rays, as many rays as there is room for.

    Args:
        bresenham: whether the paper's integer lines are followed, to where a ray leaves the grid or
            ends.
        origin, directions, reach, grid: as in `clip_rays`.
        spans: from `clip_rays`.
        voxels: indices go here, unsigned; room for `sum(grid.shape)` is enough for a ray.
        offsets: those of ray n are `voxels[offsets[n]:offsets[n + 1]]`.

    Returns:
        The number of rays written, at most `len(offsets) - 1`.
    """
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

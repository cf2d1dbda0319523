"""Voxels: points grouped by cell of a 3D grid, each voxel the mean of its points."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.detectors.detector import PointRange
from training.ops.sparse_conv import SparseTensor
from training.ops.sparse_rules import Triple


@dataclass(frozen=True)
class VoxelGrid:
    """A grid of voxels over a range."""

    point_range: PointRange  # lowest and highest corner, metres; whole voxels along each axis
    size: tuple[float, float, float]  # edges of a voxel along x, y, z, metres
    max_points: int | None = None  # points of a voxel beyond this number are dropped
    max_voxels: tuple[int, int] | None = None  # so are voxels, in training and in evaluation

    @property
    def cells(self) -> Triple:
        """Number of voxels along z, y, x."""
        low, high = self.point_range[:3], self.point_range[3:]
        nx, ny, nz = (round((high[i] - low[i]) / self.size[i]) for i in range(3))
        return nz, ny, nx

    @property
    def shape(self) -> Triple:
        """Cells along z, y, x of the sparse tensor: OpenPCDet adds an empty layer on top."""
        nz, ny, nx = self.cells
        return nz + 1, ny, nx

    def edges_and_corner(self, like: Tensor) -> tuple[Tensor, Tensor]:
        """Edges of a voxel and the lowest corner, (3,) each, along x, y, z, metres.

        On the device of `like`, whose host does not wait, and with its dtype."""
        constants = torch.tensor([self.size, self.point_range[:3]], dtype=like.dtype)
        edges, corner = constants.to(like.device, non_blocking=True)
        return edges, corner

    def centres(self, coordinates: Tensor, stride: int, dtype: torch.dtype) -> Tensor:
        """Centres (N, 3), metres, of voxels frame, z, y, x with `stride` times the grid's edge."""
        place = coordinates[:, 1:].flip(1).to(dtype)
        edges, corner = self.edges_and_corner(place)
        return (place + 0.5) * (edges * stride) + corner


@njit(cache=True)
def _voxel_kernel(points, low, size, cells, max_points, max_voxels):
    """Keys ((z * ny + y) * nx + x) of the voxels and the means of their points."""
    nz, ny, nx = cells
    # A hash table with open addressing: a table of all cells would be far larger than the cloud.
    slots = 16
    while slots < 2 * len(points):
        slots *= 2
    table, last = np.full(slots, -1, np.int32), np.uint64(slots - 1)
    keys = np.empty(min(len(points), max_voxels), np.int64)
    counts = np.zeros(len(keys), np.int64)
    sums = np.zeros((len(keys), points.shape[1]))
    voxels = 0
    for i in range(len(points)):
        # float32 throughout, as upstream: a point on a face must fall on the same side.
        fx = np.floor((points[i, 0] - low[0]) / size[0])
        fy = np.floor((points[i, 1] - low[1]) / size[1])
        fz = np.floor((points[i, 2] - low[2]) / size[2])
        inside = 0 <= fx < nx and 0 <= fy < ny and 0 <= fz < nz
        if not (inside and np.isfinite(points[i, 3])):
            continue
        key = (np.int64(fz) * ny + np.int64(fy)) * nx + np.int64(fx)
        # Multiplicative hashing with the golden ratio (Knuth, The art of computer programming 3).
        slot = (np.uint64(key) * np.uint64(11400714819323198485) >> np.uint64(20)) & last
        while table[slot] >= 0 and keys[table[slot]] != key:
            slot = (slot + np.uint64(1)) & last
        voxel = table[slot]
        if voxel < 0:
            if voxels == max_voxels:
                continue
            voxel = table[slot] = voxels
            keys[voxel] = key
            voxels += 1
        if counts[voxel] < max_points:
            counts[voxel] += 1
            for c in range(points.shape[1]):
                sums[voxel, c] += points[i, c]
    means = np.empty((voxels, points.shape[1]), np.float32)
    for i in range(voxels):
        for c in range(points.shape[1]):
            means[i, c] = sums[i, c] / counts[i]
    return keys[:voxels], means


def voxelise(
    frames: Sequence[Tensor], grid: VoxelGrid, training: bool, device: torch.device
) -> SparseTensor:
    """Average the points (M, 4) in each voxel, (N, 4) float32; points outside are dropped.

    A point on the far face of the range is outside, one that is not finite too. The first points
    of a voxel and the first voxels of a frame are kept, as OpenPCDet's voxeliser does."""
    low, size = (np.array(item, np.float32) for item in (grid.point_range[:3], grid.size))
    unlimited = np.iinfo(np.int64).max
    max_points = grid.max_points or unlimited
    max_voxels = unlimited if grid.max_voxels is None else grid.max_voxels[0 if training else 1]
    if device.type != "cpu":
        from training.ops.gpu.grouping import means_by_cell

        corners, limits = (low.tolist(), size.tolist()), (max_points, max_voxels)
        means = means_by_cell(frames, device, corners, grid.cells, limits)
        return SparseTensor(*means, grid.shape, len(frames))
    parts = []
    for index, frame in enumerate(frames):
        points = np.ascontiguousarray(frame.detach().cpu().numpy(), np.float32)
        keys, means = _voxel_kernel(points, low, size, grid.cells, max_points, max_voxels)
        order = np.argsort(keys)
        place = np.unravel_index(keys[order], grid.cells)
        parts.append((means[order], np.stack([np.full_like(keys, index), *place], axis=1)))
    features, coordinates = (
        torch.from_numpy(np.concatenate(part)) for part in zip(*parts, strict=True)
    )
    return SparseTensor(features, coordinates, grid.shape, len(frames))

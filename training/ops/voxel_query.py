"""Voxel query: neighbours among the voxels of a sparse grid (Voxel R-CNN, AAAI 2021)."""

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.ops.grouping import chunks, first_hits, padded_with_first


def voxel_query(
    max_range: tuple[int, int, int],
    radius: float,
    samples: int,
    xyz: Tensor,
    coordinates: Tensor,
    shape: tuple[int, int, int],
    new_xyz: Tensor,
    new_coordinates: Tensor,
) -> tuple[Tensor, Tensor]:
    """For each new point the first S occupied voxels, in their order, around its own and close by.

    At most `max_range` steps away along z, y, x, and their centres `radius` metres. The occupied
    voxels have finite centres `xyz` (N, 3), and frame, z, y, x (N, 4) int64, rows sorted and all
    different, in a grid of `shape` voxels along z, y, x; new points (M, 3) have theirs alike, which
    may lie outside. Returns rows and which new points have no neighbour, as `ball_query` does.
    """
    search = _query_numba if xyz.is_cpu else _query_torch
    voxels, places = (xyz.detach(), coordinates, shape), (new_xyz.detach(), new_coordinates)
    return search(max_range, radius, samples, *voxels, *places)


@njit(cache=True)
def _query_kernel(reach, squared, xyz, coordinates, shape, new_xyz, new_coordinates, idx, empty):
    nz, ny, _ = shape
    frames = coordinates[-1, 0] + 1 if len(coordinates) else 0
    # Where the voxels of each line along x begin.
    first = np.zeros(frames * nz * ny + 1, np.int64)
    for i in range(len(coordinates)):
        line = (coordinates[i, 0] * nz + coordinates[i, 1]) * ny + coordinates[i, 2]
        first[line + 1] += 1
    first = np.cumsum(first)
    for m in range(len(new_xyz)):
        frame, cz, cy, cx = new_coordinates[m]
        found = 0
        for z in range(max(cz - reach[0], 0), min(cz + reach[0] + 1, nz) if frame < frames else 0):
            for y in range(max(cy - reach[1], 0), min(cy + reach[1] + 1, ny)):
                line = (frame * nz + z) * ny + y
                i, stop = first[line], first[line + 1]
                i += np.searchsorted(coordinates[i:stop, 3], cx - reach[2])
                while i < stop and coordinates[i, 3] <= cx + reach[2] and found < idx.shape[1]:
                    dx = new_xyz[m, 0] - xyz[i, 0]
                    dy = new_xyz[m, 1] - xyz[i, 1]
                    dz = new_xyz[m, 2] - xyz[i, 2]
                    if dx * dx + dy * dy + dz * dz <= squared:
                        idx[m, found] = i
                        found += 1
                    i += 1
        empty[m] = found == 0
        if found > 0:
            idx[m, found:] = idx[m, 0]


def _query_numba(
    max_range, radius, samples, xyz, coordinates, shape, new_xyz, new_coordinates
) -> tuple[Tensor, Tensor]:
    points, voxels = xyz.contiguous().numpy(), coordinates.contiguous().numpy()
    places = new_xyz.contiguous().numpy(), new_coordinates.contiguous().numpy()
    idx, empty = np.zeros((len(new_xyz), samples), np.int64), np.empty(len(new_xyz), bool)
    squared = points.dtype.type(radius) * points.dtype.type(radius)
    _query_kernel(tuple(max_range), squared, points, voxels, tuple(shape), *places, idx, empty)
    return torch.from_numpy(idx), torch.from_numpy(empty)


def _query_torch(
    max_range, radius, samples, xyz, coordinates, shape, new_xyz, new_coordinates
) -> tuple[Tensor, Tensor]:
    idx = torch.zeros(len(new_xyz), samples, dtype=torch.int64, device=xyz.device)
    empty = torch.ones(len(new_xyz), dtype=torch.bool, device=xyz.device)
    if len(xyz) == 0:
        return idx, empty
    squared = torch.tensor(radius, dtype=xyz.dtype, device=xyz.device).square()
    size = torch.tensor(shape, device=xyz.device)
    steps = [torch.arange(-reach, reach + 1, device=xyz.device) for reach in max_range]
    offsets = torch.cartesian_prod(*steps)
    keys = _key(coordinates[:, 0], coordinates[:, 1:], shape)
    for own in chunks(len(new_xyz), 4 * len(offsets)):  # a few numbers of each
        around = new_coordinates[own, None, 1:] + offsets
        key = _key(new_coordinates[own, None, 0], around, shape)
        row = torch.searchsorted(keys, key).clamp_max(len(keys) - 1)
        occupied = ((around >= 0) & (around < size)).all(dim=2) & (keys[row] == key)
        dx, dy, dz = (new_xyz[own, None] - xyz[row]).unbind(dim=2)
        hits, found = first_hits(occupied & (dx * dx + dy * dy + dz * dz <= squared), samples)
        empty[own] = found == 0
        neighbours = row.gather(1, padded_with_first(hits, found))
        idx[own] = torch.where(empty[own, None], 0, neighbours)
    return idx, empty


def _key(frame: Tensor, zyx: Tensor, shape: tuple[int, int, int]) -> Tensor:
    """A number for each voxel (…, 3) of the grid that rises in the order of the rows."""
    z, y, x = zyx.unbind(dim=-1)
    return ((frame * shape[0] + z) * shape[1] + y) * shape[2] + x

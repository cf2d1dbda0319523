"""Voxel query: neighbours among the voxels of a sparse grid (Voxel R-CNN, AAAI 2021)."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.ops.sparse_rules import Triple


class OccupiedVoxels(NamedTuple):
    """Voxels of a sparse grid that are not empty."""

    xyz: Tensor  # their centres, finite, shape (N, 3), metres
    coordinates: Tensor  # frame, z, y, x, rows sorted and all different, shape (N, 4), int64
    shape: Triple  # voxels of the grid along z, y, x


def voxel_query(
    reach: Triple,
    radius: float,
    samples: int,
    voxels: OccupiedVoxels,
    new_xyz: Tensor,
    new_coordinates: Tensor,
) -> tuple[Tensor, Tensor]:
    """Find the first S occupied voxels, in their order, around and close by each new point.

    At most `reach` steps away along z, y, x, and their centres `radius` metres. New points (M, 3)
    have coordinates (M, 4) as the voxels have, which may lie outside. Returns rows and which new
    points have no neighbour, as `ball_query` does."""
    search = _query_numba if voxels.xyz.is_cpu else _query_triton
    voxels = voxels._replace(xyz=voxels.xyz.detach())
    return search(reach, radius, samples, voxels, new_xyz.detach(), new_coordinates)


@njit(cache=True)
def _query_kernel(reach, squared, voxels, new_xyz, new_coordinates, idx, empty):
    xyz, coordinates, (nz, ny, _) = voxels
    frames = coordinates[-1, 0] + 1 if len(coordinates) else 0
    # Where the voxels of each line along x begin.
    first = np.zeros(frames * nz * ny + 1, np.int64)
    for i in range(len(coordinates)):
        line = (coordinates[i, 0] * nz + coordinates[i, 1]) * ny + coordinates[i, 2]
        first[line + 1] += 1
    first = np.cumsum(first)
    for m in range(len(new_xyz)):
        frame, cz, cy, cx = new_coordinates[m]
        hits = 0
        for z in range(max(cz - reach[0], 0), min(cz + reach[0] + 1, nz) if frame < frames else 0):
            for y in range(max(cy - reach[1], 0), min(cy + reach[1] + 1, ny)):
                line = (frame * nz + z) * ny + y
                i, stop = first[line], first[line + 1]
                i += np.searchsorted(coordinates[i:stop, 3], cx - reach[2])
                while i < stop and coordinates[i, 3] <= cx + reach[2] and hits < idx.shape[1]:
                    dx = new_xyz[m, 0] - xyz[i, 0]
                    dy = new_xyz[m, 1] - xyz[i, 1]
                    dz = new_xyz[m, 2] - xyz[i, 2]
                    if dx * dx + dy * dy + dz * dz <= squared:
                        idx[m, hits] = i
                        hits += 1
                    i += 1
        empty[m] = hits == 0
        if hits > 0:
            idx[m, hits:] = idx[m, 0]


def _query_numba(reach, radius, samples, voxels, new_xyz, new_coordinates) -> tuple[Tensor, Tensor]:
    points, coordinates = (part.contiguous().numpy() for part in voxels[:2])
    places = new_xyz.contiguous().numpy(), new_coordinates.contiguous().numpy()
    idx, empty = np.zeros((len(new_xyz), samples), np.int64), np.empty(len(new_xyz), bool)
    squared = points.dtype.type(radius) * points.dtype.type(radius)
    occupied = (points, coordinates, tuple(voxels.shape))
    _query_kernel(tuple(reach), squared, occupied, *places, idx, empty)
    return torch.from_numpy(idx), torch.from_numpy(empty)


def _query_triton(reach, radius, samples, voxels, new_xyz, new_coordinates):
    from training.ops.gpu.neighbours import voxels_around

    (xyz, coordinates, shape), (_, ny, nx) = voxels, voxels.shape
    frame, z, y, x = coordinates.unbind(dim=1)
    keys = ((frame * shape[0] + z) * ny + y) * nx + x
    squared = torch.tensor(radius, dtype=xyz.dtype).square().item()
    new = new_xyz, new_coordinates
    return voxels_around(reach, squared, samples, (xyz, keys, shape), new)

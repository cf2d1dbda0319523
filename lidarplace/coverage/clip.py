"""Where rays enter and leave the grid of voxels: the slab test that both walks share."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit


class VoxelGrid(NamedTuple):
    """The voxels, as compiled code takes them.

    Attributes:
        minimum: lower corner, ego frame, shape (3,), metres.
        resolution: edge of a voxel, metres.
        shape: voxels along the axes, int64, shape (3,).
        strides: voxel (i, j, k) has the index `i * strides[0] + j * strides[1] + k * strides[2]`.
    """

    minimum: NDArray[np.float64]
    resolution: float
    shape: NDArray[np.int64]
    strides: NDArray[np.int64]


@njit(cache=True, nogil=True, error_model="numpy")
def clip_rays(origin, directions, reach, grid):
    """Ray parameters between which rays are in the grid; (inf, -inf) for those that miss it.

    Args:
        origin: start of all rays, ego frame, shape (3,), metres.
        directions: unit vectors, ego frame, shape (rays, 3).
        reach: length of the rays, metres; what ends before the grid misses it.
        grid: a `VoxelGrid`.

    Returns:
        Entry (0 for an origin in the grid) and exit, metres, float64, shape (rays, 2).
    """
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

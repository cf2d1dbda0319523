"""Exact traversal of single rays through the voxels (Amanatides and Woo, 1987)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def dda_voxels(origin, directions, reach, minimum, resolution, nx, ny, nz):
    """Voxels that rays pass, in the order in which they pass them.

    Args:
        origin: start of all rays, ego frame, shape (3,), metres; may lie outside the grid.
        directions: unit vectors, ego frame, shape (rays, 3).
        reach: length of the rays, metres.
        minimum, resolution, nx, ny, nz: the grid.

    Returns:
        (voxels, offsets): flat C-order indices, int64; those of ray r are
        `voxels[offsets[r]:offsets[r + 1]]`.
    """
    rays = len(directions)
    shape = (nx, ny, nz)
    stride = (ny * nz, nz, 1)
    voxels = np.empty(rays * (nx + ny + nz), np.int64)
    offsets = np.zeros(rays + 1, np.int64)
    size = 0
    cell = np.zeros(3, np.int64)
    step = np.zeros(3, np.int64)
    crossing = np.zeros(3)  # ray parameter at which the next voxel of an axis begins
    for r in range(rays):
        near, far = 0.0, reach
        for a in range(3):
            low = minimum[a] - origin[a]
            high = low + shape[a] * resolution
            d = directions[r, a]
            if d == 0.0:
                if low > 0 or high <= 0:  # voxels are half open
                    far = -1.0
            else:
                t0, t1 = low / d, high / d
                near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
        if near < far:
            index = 0
            for a in range(3):
                d = directions[r, a]
                position = (origin[a] + near * d - minimum[a]) / resolution
                cell[a] = min(max(math.floor(position), 0), shape[a] - 1)
                index += cell[a] * stride[a]
                if d == 0.0:
                    step[a], crossing[a] = 0, math.inf
                else:
                    step[a] = 1 if d > 0 else -1
                    edge = minimum[a] + (cell[a] + (step[a] > 0)) * resolution
                    crossing[a] = (edge - origin[a]) / d
            while True:
                voxels[size] = index
                size += 1
                a = 0 if crossing[0] < crossing[1] else 1
                if crossing[2] < crossing[a]:
                    a = 2
                if crossing[a] >= far:
                    break
                cell[a] += step[a]
                if cell[a] < 0 or cell[a] >= shape[a]:
                    break
                index += step[a] * stride[a]
                # From the grid line, not by adding: errors do not grow along the ray.
                edge = minimum[a] + (cell[a] + (step[a] > 0)) * resolution
                crossing[a] = (edge - origin[a]) / directions[r, a]
        offsets[r + 1] = size
    return voxels[:size], offsets

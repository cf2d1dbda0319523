"""The paper's coverage: integer Bresenham lines from the sensor's voxel (paper, section 3.2)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def bresenham_voxels(origin, directions, reach, minimum, resolution, nx, ny, nz):
    """Voxels of the 3D Bresenham line from the sensor's voxel to the one where a ray ends.

    A ray ends where it leaves the grid, or after `reach` metres. Rays that miss the grid have no
    voxel. The sensor's voxel may lie outside the grid; only voxels inside are returned.

    Arguments and result as in `dda_voxels`.
    """
    rays = len(directions)
    shape = (nx, ny, nz)
    voxels = np.empty(rays * max(nx, ny, nz), np.int64)
    offsets = np.zeros(rays + 1, np.int64)
    size = 0
    cell = np.zeros(3, np.int64)
    length = np.zeros(3, np.int64)
    step = np.zeros(3, np.int64)
    error = np.zeros(3, np.int64)
    for r in range(rays):
        near, far = 0.0, reach
        for a in range(3):
            low = minimum[a] - origin[a]
            high = low + shape[a] * resolution
            d = directions[r, a]
            if d == 0.0:
                if low > 0 or high <= 0:
                    far = -1.0
            else:
                t0, t1 = low / d, high / d
                near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
        if near < far:
            main = 0
            for a in range(3):
                cell[a] = math.floor((origin[a] - minimum[a]) / resolution)
                end = math.floor((origin[a] + far * directions[r, a] - minimum[a]) / resolution)
                end = min(max(end, 0), shape[a] - 1)
                length[a] = abs(end - cell[a])
                step[a] = 1 if end > cell[a] else -1
                if length[a] > length[main]:
                    main = a
            for a in range(3):
                error[a] = 2 * length[a] - length[main]
            for _ in range(length[main] + 1):
                if 0 <= cell[0] < shape[0] and 0 <= cell[1] < shape[1] and 0 <= cell[2] < shape[2]:
                    voxels[size] = (cell[0] * ny + cell[1]) * nz + cell[2]
                    size += 1
                for a in range(3):
                    if a == main:
                        continue
                    if error[a] > 0:
                        cell[a] += step[a]
                        error[a] -= 2 * length[main]
                    error[a] += 2 * length[a]
                cell[main] += step[main]
        offsets[r + 1] = size
    return voxels[:size], offsets

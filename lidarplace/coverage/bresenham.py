"""The paper's coverage: integer Bresenham lines from the sensor's voxel (paper, section 3.2)."""

import math

import numpy as np

from lidarplace.base.kernel_cache import inner


@inner
def walk_bresenham(origin, direction, far, grid, voxels, size):
    """Append the voxels of one line to the first `size` of `voxels`; return the new size.

    It goes from the sensor's voxel, inside the grid or not, to that of the ray at `far`."""
    shape, strides = grid.shape, grid.strides
    # The axis along which the line is longest comes first.
    main, longest = 0, -1
    for a in range(3):
        start, end = _ends(a, origin, direction, far, grid)
        if abs(end - start) > longest:
            main, longest = a, abs(end - start)
    a, b = (1 if main == 0 else 0), (1 if main == 2 else 2)
    i, end_i = _ends(main, origin, direction, far, grid)
    j, end_j = _ends(a, origin, direction, far, grid)
    k, end_k = _ends(b, origin, direction, far, grid)
    up_i, up_j, up_k = (1 if end_i > i else -1), (1 if end_j > j else -1), (1 if end_k > k else -1)
    length_j, length_k = abs(end_j - j), abs(end_k - k)
    error_j, error_k = 2 * length_j - longest, 2 * length_k - longest
    ni, nj, nk = shape[main], shape[a], shape[b]
    for _ in range(longest + 1):
        if 0 <= i < ni and 0 <= j < nj and 0 <= k < nk:
            voxels[size] = i * strides[main] + j * strides[a] + k * strides[b]
            size += np.uint64(1)
        if error_j > 0:
            j += up_j
            error_j -= 2 * longest
        if error_k > 0:
            k += up_k
            error_k -= 2 * longest
        error_j += 2 * length_j
        error_k += 2 * length_k
        i += up_i
    return size


@inner
def _ends(axis, origin, direction, far, grid):
    """Return first and last cell of a line on one axis: the sensor's, and the ray's at `far`."""
    minimum, resolution = grid.minimum[axis], grid.resolution
    start = math.floor((origin[axis] - minimum) / resolution)
    end = math.floor((origin[axis] + far * direction[axis] - minimum) / resolution)
    return start, min(max(end, 0), grid.shape[axis] - 1)

"""Ball query: neighbours within a radius."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.base.kernel_cache import inner, njit
from training.ops.grouping import counting_sort


def ball_query(
    radius: float, samples: int, xyz: Tensor, counts: Tensor, new_xyz: Tensor, new_counts: Tensor
) -> tuple[Tensor, Tensor]:
    """Find the first S points of its frame, in their order, closer than `radius` to each new point.

    Points `xyz` (N, 3) and `new_xyz` (M, 3) are finite, frame after frame, `counts` and
    `new_counts` (B,) of them. Returns rows of `xyz`, (M, S) int64; the first repeats where there
    are fewer, all are 0 where there is none. And which new points have no neighbour, (M,) bool."""
    search = _query_numba if xyz.is_cpu else _query_triton
    return search(radius, samples, xyz.detach(), counts, new_xyz.detach(), new_counts)


class _Columns(NamedTuple):
    """Points of a frame by the columns of a horizontal grid, nx columns a row."""

    low: NDArray[np.float64]  # corner of the grid, x and y
    width: float  # of a column, at least the radius
    nx: int
    ny: int
    first: NDArray[np.int64]  # where the rows of each column begin, shape (nx * ny + 1,)
    rows: NDArray[np.int64]  # rows of points, column after column, rising within each


@inner
def _columns(radius, xyz):
    """Sort points into columns, a few for each point at most."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(len(xyz)):
        for axis in range(2):
            low[axis] = min(low[axis], xyz[i, axis])
            high[axis] = max(high[axis], xyz[i, axis])
    most = int(2 * np.sqrt(len(xyz))) + 1
    # Wider than the radius by more than rounding may lose.
    width = max(1.001 * radius, (high[0] - low[0]) / most, (high[1] - low[1]) / most)
    nx = int((high[0] - low[0]) / width) + 1
    ny = int((high[1] - low[1]) / width) + 1
    column = np.empty(len(xyz), np.int64)
    for i in range(len(xyz)):
        column[i] = int((xyz[i, 1] - low[1]) / width) * nx + int((xyz[i, 0] - low[0]) / width)
    rows, first = counting_sort(column, nx * ny)
    return _Columns(low, width, nx, ny, first, rows)


@njit(cache=True)
def _query_kernel(radius, squared, xyz, new_xyz, idx, empty):
    """Search the points of a frame for the neighbours of `new_xyz`.

    The rows of the nine columns around a new point are merged in rising order, and the search ends
    with the last sample: its cost depends little on the number of points."""
    low, width, nx, ny, first, rows = _columns(radius, xyz)
    head, tail = np.empty(9, np.int64), np.empty(9, np.int64)
    for m in range(len(new_xyz)):
        # Clipped before they become integers: a new point may be anywhere.
        fx = min(max((new_xyz[m, 0] - low[0]) / width, -2.0), nx + 1.0)
        fy = min(max((new_xyz[m, 1] - low[1]) / width, -2.0), ny + 1.0)
        ix, iy = int(np.floor(fx)), int(np.floor(fy))
        runs = 0
        for jy in range(max(iy - 1, 0), min(iy + 2, ny)):
            for jx in range(max(ix - 1, 0), min(ix + 2, nx)):
                cell = jy * nx + jx
                if first[cell] < first[cell + 1]:
                    head[runs], tail[runs] = first[cell], first[cell + 1]
                    runs += 1
        hits = 0
        while runs > 0 and hits < idx.shape[1]:
            run = 0
            for k in range(1, runs):
                if rows[head[k]] < rows[head[run]]:
                    run = k
            i = rows[head[run]]
            head[run] += 1
            if head[run] == tail[run]:
                runs -= 1
                head[run], tail[run] = head[runs], tail[runs]
            dx = new_xyz[m, 0] - xyz[i, 0]
            dy = new_xyz[m, 1] - xyz[i, 1]
            dz = new_xyz[m, 2] - xyz[i, 2]
            if dx * dx + dy * dy + dz * dz < squared:
                idx[m, hits] = i
                hits += 1
        empty[m] = hits == 0
        if hits > 0:
            idx[m, hits:] = idx[m, 0]


def _query_numba(radius, samples, xyz, counts, new_xyz, new_counts) -> tuple[Tensor, Tensor]:
    points, centres = xyz.contiguous().numpy(), new_xyz.contiguous().numpy()
    idx = np.zeros((len(centres), samples), np.int64)
    empty = np.ones(len(centres), bool)
    # In the points' own precision, as upstream.
    squared = points.dtype.type(radius) * points.dtype.type(radius)
    start = new_start = 0
    for count, new_count in zip(counts.tolist(), new_counts.tolist(), strict=True):
        frame, new = slice(start, start + count), slice(new_start, new_start + new_count)
        if count:
            _query_kernel(radius, squared, points[frame], centres[new], idx[new], empty[new])
            idx[new] += np.where(empty[new, None], 0, start)
        start, new_start = frame.stop, new.stop
    return torch.from_numpy(idx), torch.from_numpy(empty)


def _query_triton(radius, samples, xyz, counts, new_xyz, new_counts) -> tuple[Tensor, Tensor]:
    from training.ops.gpu.neighbours import balls

    squared = torch.tensor(radius, dtype=xyz.dtype).square().item()
    return balls(squared, samples, xyz, counts, new_xyz, new_counts)

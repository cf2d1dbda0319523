"""Tables of sparse convolutions: the site at every place of every window of the kernel.

Sites and the first places of windows have keys in the padded grid, which no window leaves: a step
within a window adds the same to every key."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit

Triple = tuple[int, int, int]  # along z, y, x


@dataclass(frozen=True)
class Rules:
    """Pairs of N input and M output rows of a convolution with K kernel positions."""

    inputs: Tensor  # input row at each position of each output row, -1: none, (K, M), int32
    outputs: Tensor  # output row with each input row at each position, -1: none, (K, N), int32


@dataclass(frozen=True)
class Windows:
    """The windows of a convolution over a grid."""

    shape: Triple  # cells of the grid along z, y, x
    kernel: Triple
    stride: Triple
    padding: Triple

    @property
    def extents(self) -> Triple:
        """Cells of the padded grid along z, y, x."""
        nz, ny, nx = (self.shape[i] + 2 * self.padding[i] for i in range(3))
        return nz, ny, nx

    @property
    def counts(self) -> Triple:
        """Number of windows along z, y, x."""
        nz, ny, nx = ((self.extents[i] - self.kernel[i]) // self.stride[i] + 1 for i in range(3))
        return nz, ny, nx


def submanifold_rules(coordinates: Tensor, shape: Triple, kernel: Triple) -> Rules:
    """Pair the sites that are neighbours: input and output have the same sites.

    Coordinates frame, z, y, x (N, 4), int64, are sorted, the sizes of `kernel` odd."""
    z, y, x = (size // 2 for size in kernel)
    windows = Windows(shape, kernel, (1, 1, 1), (z, y, x))
    return _rules(coordinates, _keys(coordinates, windows.extents), windows)


def strided_rules(coordinates: Tensor, windows: Windows) -> tuple[Rules, Tensor]:
    """Pair each site with the windows that hold it; also their coordinates (M, 4)."""
    reached = _reached_numba if coordinates.is_cpu else _reached_triton
    starts = reached(coordinates, windows)
    nz, ny, nx = windows.extents
    level, plane, row = starts // (nx * ny), starts // nx, starts
    places = (level % nz, plane % ny, row % nx)
    cells = (place // step for place, step in zip(places, windows.stride, strict=True))
    reached_cells = torch.stack([level // nz, *cells], dim=1)
    return _rules(coordinates, starts, windows), reached_cells


def _rules(coordinates: Tensor, starts: Tensor, windows: Windows) -> Rules:
    """Rules of the windows with these first places (M,), sorted."""
    (_, ny, nx), (z, y, x) = windows.extents, windows.padding
    keys = _keys(coordinates, windows.extents) + ((z * ny + y) * nx + x)
    tables = _tables_numba if keys.is_cpu else _tables_triton
    return Rules(*tables(keys, starts, windows))


def _keys(coordinates: Tensor, extents: Triple) -> Tensor:
    """Keys (N,) of cells frame, z, y, x (N, 4)."""
    keys, *cells = coordinates.unbind(dim=1)
    for cell, extent in zip(cells, extents, strict=True):
        keys = torch.add(cell, keys, alpha=extent)
    return keys


def _tables_numba(keys: Tensor, starts: Tensor, windows: Windows) -> tuple[Tensor, Tensor]:
    kernel, extents = windows.kernel, windows.extents
    inputs, outputs = _table_kernel(keys.numpy(), starts.numpy(), extents, kernel)
    return torch.from_numpy(inputs), torch.from_numpy(outputs)


def _tables_triton(keys: Tensor, starts: Tensor, windows: Windows) -> tuple[Tensor, Tensor]:
    from training.ops.gpu.sparse_rules import tables

    return tables(keys, starts, windows.extents, windows.kernel)


def _reached_numba(coordinates: Tensor, windows: Windows) -> Tensor:
    """First places of the windows that hold a site, sorted, none twice, (M,) int64."""
    geometry = windows.kernel, windows.stride, windows.padding
    starts = _start_kernel(coordinates.numpy(), windows.extents, windows.counts, *geometry)
    starts.sort()
    return torch.from_numpy(starts[np.diff(starts, prepend=-1) > 0])


def _reached_triton(coordinates: Tensor, windows: Windows) -> Tensor:
    from training.ops.gpu.sparse_rules import window_starts

    geometry = windows.kernel, windows.stride, windows.padding
    starts = window_starts(coordinates, windows.extents, windows.counts, *geometry)
    unique: Tensor = torch.unique(starts)
    return unique[:-1]  # the largest number stands for no window


@njit(cache=True)
def _table_kernel(keys, starts, extents, kernel):
    """Tables of inputs and outputs, as of `Rules`."""
    (_, ny, nx), (kz, ky, kx) = extents, kernel
    inputs = np.full((kz * ky * kx, len(starts)), -1, np.int32)
    outputs = np.full((kz * ky * kx, len(keys)), -1, np.int32)
    for line in range(kz * ky):
        step = (line // ky * ny + line % ky) * nx
        # Both sides are sorted: one walk along them, as in a merge.
        row = 0
        for i in range(len(starts)):
            start = starts[i] + step
            while row < len(keys) and keys[row] < start:
                row += 1
            near = row
            while near < len(keys) and keys[near] < start + kx:
                position = line * kx + keys[near] - start
                inputs[position, i] = near
                outputs[position, near] = i
                near += 1
    return inputs, outputs


@njit(cache=True)
def _start_kernel(coordinates, extents, counts, kernel, stride, padding):
    """First places of all windows that hold a site, site after site."""
    most = 1
    for axis in range(3):
        most *= (kernel[axis] - 1) // stride[axis] + 1
    starts = np.empty(len(coordinates) * most, np.int64)
    total = 0
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for i in range(len(coordinates)):
        for axis in range(3):
            cell = coordinates[i, axis + 1] + padding[axis]
            first[axis] = max((cell - kernel[axis]) // stride[axis] + 1, 0)
            last[axis] = min(cell // stride[axis], counts[axis] - 1)
        for z in range(first[0], last[0] + 1):
            level = coordinates[i, 0] * extents[0] + z * stride[0]
            for y in range(first[1], last[1] + 1):
                row = (level * extents[1] + y * stride[1]) * extents[2]
                for x in range(first[2], last[2] + 1):
                    starts[total] = row + x * stride[2]
                    total += 1
    return starts[:total]

"""Pairs of input and output rows of sparse convolutions, for each position of the kernel.

What torch does slowly on a CPU is done in numba there; both give the same tables."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from lidarplace.base.kernel_cache import njit
from training.ops.grouping import counting_sort

Triple = tuple[int, int, int]  # along z, y, x


@dataclass(frozen=True)
class Rules:
    """The pairs of one convolution between N input and M output rows."""

    inputs: Tensor  # rows of the pairs, position after position, shape (P,), int64
    outputs: Tensor  # the same
    counts: tuple[int, ...]  # pairs of each position
    by_input: tuple[Tensor, Tensor]  # order of the pairs, (P,), and where a row begins, (N + 1,)
    by_output: tuple[Tensor, Tensor]  # the same by output row, (P,) and (M + 1,)


def submanifold_rules(coordinates: Tensor, shape: Triple, kernel: Triple) -> Rules:
    """Pair the sites that are neighbours: input and output have the same sites.

    Coordinates frame, z, y, x (N, 4), int64, are sorted, the sizes of `kernel` odd."""
    device = coordinates.device
    # A margin around the grid: what lies beyond an edge must not be taken for a cell of the next
    # row of cells.
    nz, ny, nx = (size + edge - 1 for size, edge in zip(shape, kernel, strict=True))
    strides = torch.tensor([nz * ny * nx, ny * nx, nx, 1], device=device)
    keys = (coordinates * strides).sum(dim=1)
    reach = torch.tensor([size // 2 for size in kernel], device=device)
    axes = [torch.arange(size, device=device) for size in kernel]
    positions = torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1).view(-1, 3)
    # The kernel's first half is enough: a pair of its position k is, turned round, one of the k-th
    # from the end. The position in the middle pairs every site with itself.
    steps = ((positions - reach) * strides[1:]).sum(dim=1)[: len(positions) // 2]
    if device.type == "cpu":
        neighbours = _neighbours_numba(keys.numpy(), steps.numpy())
        inputs, outputs, half = map(torch.from_numpy, neighbours)
    else:
        inputs, outputs, half = _neighbours_torch(keys, steps)
    same, count = torch.arange(len(keys), device=device), len(keys)
    counts = [*half.tolist(), count, *half.flip(0).tolist()]
    inputs, outputs = (
        torch.cat([rows, same, mirrored.flip(0)])
        for rows, mirrored in ((inputs, outputs), (outputs, inputs))
    )
    return _table(inputs, outputs, counts, (count, count))


def strided_rules(
    coordinates: Tensor, shape: Triple, kernel: Triple, stride: Triple, padding: Triple
) -> tuple[Rules, Tensor]:
    """Pair each site with the cells whose window holds it; also their coordinates (M, 4)."""
    nz, ny, nx = output_shape(shape, kernel, stride, padding)
    geometry = (nz, ny, nx), kernel, stride, padding
    inputs, outputs, counts, cells = _reached(coordinates, *geometry)
    plane, level, frame = (
        torch.div(cells, count, rounding_mode="floor") for count in (nx, nx * ny, nx * ny * nz)
    )
    reached = torch.stack([frame, level % nz, plane % ny, cells % nx], dim=1)
    return _table(inputs, outputs, counts.tolist(), (len(coordinates), len(cells))), reached


def output_shape(shape: Triple, kernel: Triple, stride: Triple, padding: Triple) -> Triple:
    """Cells of the grid that a strided convolution makes."""
    nz, ny, nx = ((shape[i] + 2 * padding[i] - kernel[i]) // stride[i] + 1 for i in range(3))
    return nz, ny, nx


def _table(inputs: Tensor, outputs: Tensor, counts: list[int], rows: tuple[int, int]) -> Rules:
    by_input, by_output = _by_row(inputs, rows[0]), _by_row(outputs, rows[1])
    return Rules(inputs, outputs, tuple(counts), by_input, by_output)


def _by_row(rows: Tensor, count: int) -> tuple[Tensor, Tensor]:
    if rows.device.type != "cpu":
        return _by_row_torch(rows, count)
    order, starts = map(torch.from_numpy, counting_sort(rows.numpy(), count))
    return order, starts


@njit(cache=True)
def _neighbours_numba(keys, steps):
    """Input and output row of the pairs whose keys differ by a step, and pairs of each step."""
    inputs = np.empty(len(keys) * len(steps), np.int64)
    outputs = np.empty_like(inputs)
    counts = np.zeros(len(steps), np.int64)
    total = 0
    for k in range(len(steps)):
        # Both sides are sorted: one walk along them, as in a merge.
        row = 0
        first = total
        for i in range(len(keys)):
            wanted = keys[i] + steps[k]
            while row < len(keys) and keys[row] < wanted:
                row += 1
            if row < len(keys) and keys[row] == wanted:
                inputs[total] = row
                outputs[total] = i
                total += 1
        counts[k] = total - first
    return inputs[:total].copy(), outputs[:total].copy(), counts


def _neighbours_torch(keys: Tensor, steps: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    wanted = keys + steps[:, None]
    rows = torch.searchsorted(keys, wanted)
    rows = rows.where(rows < len(keys), 0)
    hit = keys[rows] == wanted
    return rows[hit], torch.nonzero(hit)[:, 1], hit.sum(dim=1)


def _reached(
    coordinates: Tensor, shape: Triple, kernel: Triple, stride: Triple, padding: Triple
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Input and output row of each pair, pairs of each position, sorted cells of the output."""
    count = len(coordinates)
    cell = coordinates[:, 0].view(1, 1, 1, count)
    valid = torch.ones_like(cell, dtype=torch.bool)
    for axis in range(3):
        view = [1, 1, 1, count]
        view[axis] = kernel[axis]
        place = torch.arange(kernel[axis], device=coordinates.device)[:, None]
        shifted = coordinates[:, axis + 1] + padding[axis] - place
        out = torch.div(shifted, stride[axis], rounding_mode="floor")
        fits = (out * stride[axis] == shifted) & (out >= 0) & (out < shape[axis])
        cell = cell * shape[axis] + out.view(view)
        valid = valid & fits.view(view)
    valid = valid.flatten(0, 2)
    inputs = torch.nonzero(valid)[:, 1]
    cells, outputs = torch.unique(cell.flatten(0, 2)[valid], return_inverse=True)
    return inputs, outputs, valid.sum(dim=1), cells


def _by_row_torch(rows: Tensor, count: int) -> tuple[Tensor, Tensor]:
    ends = torch.bincount(rows, minlength=count).cumsum(0)
    return torch.argsort(rows, stable=True), functional.pad(ends, (1, 0))

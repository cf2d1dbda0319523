"""Points of frames grouped by cell of a grid, in the order of their frames."""

from collections.abc import Sequence

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.ops.gpu.bisection import count_up_to
from training.ops.gpu.launch import launch
from training.ops.grouping import stacked_counts

_LANES = 256
"""Points of a program."""


def means_by_cell(
    frames: Sequence[Tensor],
    device: torch.device,
    corners: tuple[list[float], list[float]],
    cells: tuple[int, int, int],
    limits: tuple[int, int],
) -> tuple[Tensor, Tensor]:
    """Means (V, 4) of the first points of each cell, and the cells frame, z, y, x (V, 4), sorted.

    Frames of points (N, 4). `corners`: the lowest one of the grid and the edges of a cell along
    x, y, z; `cells` along z, y, x. `limits`: points of a cell and cells of a frame, others are
    dropped. Sums are in float64 and in order."""
    points, keys, order, counts = _grouped(frames, device, corners, cells, limits, by_row=False)
    numbers = (counts > 0).cumsum(0)
    total = int(numbers[-1]) if len(numbers) else 0
    means, coordinates = points.new_empty(total, 4), order.new_empty(total, 4)
    arguments = (points, keys, order, counts, numbers, means, coordinates, len(keys), *cells)
    launch(_mean_kernel, triton.cdiv(len(keys), _LANES), *arguments, LANES=_LANES)
    return means, coordinates


def points_by_cell(
    frames: Sequence[Tensor],
    device: torch.device,
    corners: tuple[list[float], list[float]],
    cells: tuple[int, int, int],
    limits: tuple[int, int],
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """First points of each cell, (M, 4), cell after cell as they appear; see `means_by_cell`.

    Also the number of each point's cell, (M,), and points (P,) and keys (P,) of the cells."""
    points, keys, order, counts = _grouped(frames, device, corners, cells, limits, by_row=True)
    numbers, ends = (counts > 0).cumsum(0), counts.cumsum(0)
    total, kept = torch.stack([numbers[-1], ends[-1]]).tolist() if len(counts) else (0, 0)
    grouped, cell_of = points.new_empty(kept, 4), order.new_empty(kept)
    sums, cell_keys = order.new_empty(total), order.new_empty(total)
    arguments = (points, keys, order, counts, numbers, ends, grouped, cell_of, sums, cell_keys)
    launch(_copy_kernel, triton.cdiv(len(keys), _LANES), *arguments, len(keys), LANES=_LANES)
    return grouped, cell_of, sums, cell_keys


def _grouped(frames, device, corners, cells, limits, by_row) -> tuple[Tensor, ...]:
    """Points, their sorted keys, the rows of these, and how many points of a cell are used.

    The latter is at the cell's first place among the keys, or its first point's row, else zero."""
    points = torch.cat([frame.detach() for frame in frames]).to(
        device, torch.float32, non_blocking=True
    )
    count, programs = len(points), triton.cdiv(len(points), _LANES)
    sizes = stacked_counts(map(len, frames), device)
    ends = sizes.cumsum(0)
    frame_of = torch.arange(len(frames), device=device)
    frame_of = frame_of.repeat_interleave(sizes, output_size=count)
    keys = torch.empty_like(frame_of)
    grid = (*corners[0], *corners[1], *cells)
    launch(_key_kernel, programs, points, frame_of, keys, count, *grid, LANES=_LANES)
    keys, order = keys.sort(stable=True)
    first = torch.empty_like(order)
    launch(_first_kernel, programs, keys, order, first, count, LANES=_LANES)
    ranks, counts = first.cumsum(0), torch.zeros_like(order)
    arguments = (keys, order, ranks, ends - sizes, counts, count)
    bounds = (cells[0] * cells[1] * cells[2], *(min(limit, count) for limit in limits))
    launch(_count_kernel, programs, *arguments, *bounds, BY_ROW=int(by_row), LANES=_LANES)
    return points, keys, order, counts


@triton.jit(do_not_specialize=["count"])
def _key_kernel(
    points, frames, keys, count, low_x, low_y, low_z, edge_x, edge_y, edge_z, nz, ny, nx,
    LANES: tl.constexpr,
):  # fmt: skip
    row = tl.program_id(0) * LANES + tl.arange(0, LANES)
    inside = row < count
    # Rounded as on a CPU: a point on a face must fall on the same side.
    x = tl.floor(tl.div_rn(tl.load(points + 4 * row, inside, 0.0) - low_x, edge_x))
    y = tl.floor(tl.div_rn(tl.load(points + 4 * row + 1, inside, 0.0) - low_y, edge_y))
    z = tl.floor(tl.div_rn(tl.load(points + 4 * row + 2, inside, 0.0) - low_z, edge_z))
    light = tl.load(points + 4 * row + 3, inside, 0.0)
    valid = (x >= 0) & (x < nx) & (y >= 0) & (y < ny) & (z >= 0) & (z < nz)
    valid &= tl.abs(light) < float("inf")
    key = tl.load(frames + row, inside, 0) * nz + tl.where(valid, z, 0).to(tl.int64)
    key = key * ny + tl.where(valid, y, 0).to(tl.int64)
    key = key * nx + tl.where(valid, x, 0).to(tl.int64)
    tl.store(keys + row, tl.where(valid, key, 0x7FFFFFFFFFFFFFFF), inside)


@triton.jit(do_not_specialize=["count"])
def _first_kernel(keys, order, first, count, LANES: tl.constexpr):
    place = tl.program_id(0) * LANES + tl.arange(0, LANES)
    inside = place < count
    key = tl.load(keys + place, inside, 0x7FFFFFFFFFFFFFFF)
    before = tl.load(keys + place - 1, inside & (place > 0), -1)
    starts = (key != before) & (key != 0x7FFFFFFFFFFFFFFF)
    tl.store(first + tl.load(order + place, inside, 0), starts.to(tl.int64), inside)


@triton.jit(do_not_specialize=["count", "max_points", "max_cells"])
def _count_kernel(
    keys, order, ranks, starts, counts, count, cells, max_points, max_cells,
    BY_ROW: tl.constexpr, LANES: tl.constexpr,
):  # fmt: skip
    place = tl.program_id(0) * LANES + tl.arange(0, LANES)
    key = tl.load(keys + place, place < count, 0x7FFFFFFFFFFFFFFF)
    before = tl.load(keys + place - 1, (place < count) & (place > 0), -1)
    head = (key != before) & (key != 0x7FFFFFFFFFFFFFFF)
    row = tl.load(order + place, head, 0)
    start = tl.load(starts + key // cells, head, 0)
    rank = tl.load(ranks + row, head, 0) - tl.load(ranks + start - 1, head & (start > 0), 0)
    used = tl.minimum(count_up_to(keys, key, count) - place, max_points).to(tl.int64)
    slot = row if BY_ROW else place
    tl.store(counts + slot, used, head & (rank <= max_cells))


@triton.jit(do_not_specialize=["count"])
def _mean_kernel(
    points, keys, order, counts, numbers, means, coordinates, count, nz, ny, nx,
    LANES: tl.constexpr,
):  # fmt: skip
    place = tl.program_id(0) * LANES + tl.arange(0, LANES)[:, None]
    column = tl.arange(0, 4)
    used = tl.load(counts + place, place < count, 0)
    total = tl.full((LANES, 4), 0, tl.float64)
    for step in range(tl.max(used)):
        more = step < used
        row = tl.load(order + place + step, more, 0)
        total += tl.load(points + (4 * row + column), more, 0.0).to(tl.float64)
    real = used > 0
    target = 4 * (tl.load(numbers + place, real, 1) - 1) + column
    tl.store(means + target, (total / tl.where(real, used, 1)).to(tl.float32), real)
    key = tl.load(keys + place, real, 0)
    plane = tl.where(column == 1, key // nx // ny % nz, key // nx // ny // nz)
    line = tl.where(column == 2, key // nx % ny, key % nx)
    tl.store(coordinates + target, tl.where(column < 2, plane, line), real)


@triton.jit(do_not_specialize=["count"])
def _copy_kernel(
    points, keys, order, counts, numbers, ends, grouped, cell_of, sums, cell_keys, count,
    LANES: tl.constexpr,
):  # fmt: skip
    place = tl.program_id(0) * LANES + tl.arange(0, LANES)
    key = tl.load(keys + place, place < count, 0x7FFFFFFFFFFFFFFF)
    valid = key != 0x7FFFFFFFFFFFFFFF
    head = count_up_to(keys, key - 1, count)
    first = tl.load(order + head, valid, 0)
    used = tl.load(counts + first, valid, 0)
    number = tl.load(numbers + first, valid, 1) - 1
    step = place - head
    real = valid & (step < used)
    target = tl.load(ends + first, real, 0) - used + step
    tl.store(cell_of + target, number, real)
    tl.store(sums + number, used, real & (step == 0))
    tl.store(cell_keys + number, key, real & (step == 0))
    row = tl.load(order + place, real, 0)
    for column in range(4):
        tl.store(grouped + 4 * target + column, tl.load(points + 4 * row + column, real, 0.0), real)

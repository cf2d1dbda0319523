"""Searches for neighbours, a program for a block of new points: balls, voxels, the three nearest.

Frames are stacked: rows of one after those of another, and the number of rows of each."""

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.ops.gpu.bisection import count_up_to
from training.ops.gpu.launch import launch

_ROWS, _TILE = 16, 256  # new points of a program, and points that it looks at in one go
_PLACES, _LINES = 16, 8  # new points of a voxel query's program, lines of cells in one go
_POINTS, _LANES = 32, 64  # points of a program, and places that it looks at in one go
_NO_ROW = tl.constexpr(0x7FFFFFFF)


def balls(
    squared: float, samples: int, xyz: Tensor, counts: Tensor, new_xyz: Tensor, new_counts: Tensor
) -> tuple[Tensor, Tensor]:
    """Find the first points around new points, see `ball_query`; `squared` is radius squared."""
    idx, empty = _results(len(new_xyz), samples, xyz.device)
    points = xyz.contiguous(), counts.cumsum(0), new_xyz.contiguous(), new_counts.cumsum(0)
    blocks = {"LANES": triton.next_power_of_2(samples), "ROWS": _ROWS, "TILE": _TILE}
    programs, sizes = triton.cdiv(len(new_xyz), _ROWS), (len(counts), len(new_xyz), samples)
    launch(_ball_kernel, programs, *points, idx, empty, *sizes, warps=8, SQUARED=squared, **blocks)
    return idx, empty


def voxels_around(
    reach: tuple[int, int, int],
    squared: float,
    samples: int,
    occupied: tuple[Tensor, Tensor, tuple[int, int, int]],
    new: tuple[Tensor, Tensor],
) -> tuple[Tensor, Tensor]:
    """Find the first voxels around new points, see `voxel_query`.

    `occupied`: centres (N, 3), rising numbers (N,) of cells, and shape of the grid. `new`: points
    (M, 3) and coordinates (M, 4)."""
    (xyz, keys, shape), (new_xyz, new_coordinates) = occupied, new
    idx, empty = _results(len(new_xyz), samples, xyz.device)
    places = xyz.contiguous(), keys, new_xyz.contiguous(), new_coordinates.contiguous()
    sizes = (*shape, *reach, len(keys), len(new_xyz), samples)
    blocks = {"ROWS": _PLACES, "LINES": _LINES, "LANES": triton.next_power_of_2(samples)}
    blocks["WIDTH"] = triton.next_power_of_2(2 * reach[2] + 1)
    programs = triton.cdiv(len(new_xyz), _PLACES)
    launch(_voxel_kernel, programs, *places, idx, empty, *sizes, warps=8, SQUARED=squared, **blocks)
    return idx, empty


def three_nearest(
    points: Tensor, counts: Tensor, places: Tensor, place_counts: Tensor
) -> tuple[Tensor, Tensor]:
    """Find squared distances and rows of the nearest places of each point, see `three_nn`."""
    squared = torch.empty_like(points, memory_format=torch.contiguous_format)
    idx = torch.empty(points.shape, dtype=torch.int64, device=points.device)
    stacks = points.contiguous(), counts.cumsum(0), places.contiguous(), place_counts.cumsum(0)
    programs, sizes = triton.cdiv(len(points), _POINTS), (len(counts), len(points))
    blocks = {"ROWS": _POINTS, "LANES": _LANES}
    launch(_nearest_kernel, programs, *stacks, squared, idx, *sizes, warps=8, **blocks)
    return squared, idx


def _results(rows: int, samples: int, device: torch.device) -> tuple[Tensor, Tensor]:
    idx = torch.empty(rows, samples, dtype=torch.int64, device=device)
    return idx, torch.empty(rows, dtype=torch.bool, device=device)


@triton.jit
def range_in_frame(row, new_ends, ends, frames):
    """First row, and the row behind the last, of the points in the frame of each new point.

    Both are 0 for a row behind the last new point."""
    frame = count_up_to(new_ends, row, frames)
    real = frame < frames
    first = tl.load(ends + frame - 1, real & (frame > 0), 0).to(tl.int32)
    return first, tl.load(ends + frame, real, 0).to(tl.int32)


@triton.jit
def store_hits(idx, row, columns, hit, hits, samples):
    """Store those of the `columns` that `hit` behind the `hits` of each row; count these too."""
    number = tl.sum(hit.to(tl.int32), 1)
    if tl.max(number, 0) > 0:  # most blocks hold none
        place = hits[:, None] + tl.cumsum(hit.to(tl.int32), 1) - 1
        slot = idx + row.to(tl.int64)[:, None] * samples + place
        tl.store(slot, columns.to(tl.int64), hit & (place < samples))
    return hits + number


@triton.jit
def _repeat_first(idx, empty, row, first, hits, inside, samples, LANES: tl.constexpr):
    """Fill each row of `idx` with its first hit, or with 0."""
    lane = tl.arange(0, LANES)[None, :]
    slot = idx + row.to(tl.int64)[:, None] * samples + lane
    fill = tl.where(hits > 0, first, 0).to(tl.int64)[:, None] + tl.zeros_like(lane)
    tl.store(slot, fill, inside[:, None] & (lane >= hits[:, None]) & (lane < samples))
    tl.store(empty + row, hits == 0, inside)


@triton.jit(do_not_specialize=["rows"])
def _ball_kernel(
    xyz, ends, new_xyz, new_ends, idx, empty, frames, rows, samples,
    SQUARED: tl.constexpr, LANES: tl.constexpr, ROWS: tl.constexpr, TILE: tl.constexpr,
):  # fmt: skip
    row = tl.program_id(0) * ROWS + tl.arange(0, ROWS)
    inside = row < rows
    start, stop = range_in_frame(row, new_ends, ends, frames)
    x = tl.load(new_xyz + 3 * row, inside, 0.0)[:, None]
    y = tl.load(new_xyz + 3 * row + 1, inside, 0.0)[:, None]
    z = tl.load(new_xyz + 3 * row + 2, inside, 0.0)[:, None]
    first = tl.full((ROWS,), _NO_ROW, tl.int32)
    hits = tl.where(inside, 0, samples)
    low = tl.min(tl.where(start < stop, start, _NO_ROW), 0)
    high = tl.max(stop, 0)
    while low < high:
        column = low + tl.arange(0, TILE)
        is_point = column < high
        dx = x - tl.load(xyz + 3 * column, is_point, 0.0)[None, :]
        dy = y - tl.load(xyz + 3 * column + 1, is_point, 0.0)[None, :]
        dz = z - tl.load(xyz + 3 * column + 2, is_point, 0.0)[None, :]
        hit = dx * dx + dy * dy + dz * dz < tl.full((1, 1), SQUARED, x.dtype)
        hit &= (column[None, :] >= start[:, None]) & (column[None, :] < stop[:, None])
        columns = tl.where(hit, column[None, :], _NO_ROW)
        first = tl.minimum(first, tl.min(columns, 1))
        hits = store_hits(idx, row, columns, hit, hits, samples)
        low = tl.where(tl.min(hits, 0) < samples, low + TILE, high)
    _repeat_first(idx, empty, row, first, hits, inside, samples, LANES)


@triton.jit(do_not_specialize=["count", "rows"])
def _voxel_kernel(
    xyz, keys, new_xyz, new_coordinates, idx, empty, nz, ny, nx, reach_z, reach_y, reach_x,
    count, rows, samples, SQUARED: tl.constexpr, ROWS: tl.constexpr, LINES: tl.constexpr,
    LANES: tl.constexpr, WIDTH: tl.constexpr,
):  # fmt: skip
    row = tl.program_id(0) * ROWS + tl.arange(0, ROWS)
    inside = row < rows
    x = tl.load(new_xyz + 3 * row, inside, 0.0)[:, None]
    y = tl.load(new_xyz + 3 * row + 1, inside, 0.0)[:, None]
    z = tl.load(new_xyz + 3 * row + 2, inside, 0.0)[:, None]
    frame = tl.load(new_coordinates + 4 * row, inside, 0)[:, None]
    cz = tl.load(new_coordinates + 4 * row + 1, inside, 0)[:, None]
    cy = tl.load(new_coordinates + 4 * row + 2, inside, 0)[:, None]
    cx = tl.load(new_coordinates + 4 * row + 3, inside, 0)[:, None]
    first = tl.full((ROWS,), _NO_ROW, tl.int32)
    hits = tl.where(inside, 0, samples)
    # Lines of cells along x, in the order of their voxels.
    low, across = 0, 2 * reach_y + 1
    lines = (2 * reach_z + 1) * across
    while low < lines:
        line = low + tl.arange(0, LINES)[None, :]
        line_z, line_y = cz - reach_z + line // across, cy - reach_y + line % across
        is_line = inside[:, None] & (line < lines)
        is_line &= (line_z >= 0) & (line_z < nz) & (line_y >= 0) & (line_y < ny)
        cell = ((frame * nz + line_z) * ny + line_y) * nx
        begin = count_up_to(keys, cell + tl.maximum(cx - reach_x, 0) - 1, count)
        last = cell + tl.minimum(cx + reach_x, nx - 1)
        column = begin[:, :, None] + tl.arange(0, WIDTH)[None, None, :]
        is_voxel = is_line[:, :, None] & (column < count)
        hit = is_voxel & (tl.load(keys + column, is_voxel, 0) <= last[:, :, None])
        column = tl.reshape(column, (ROWS, LINES * WIDTH))
        hit = tl.reshape(hit, (ROWS, LINES * WIDTH))
        dx = x - tl.load(xyz + 3 * column, hit, 0.0)
        dy = y - tl.load(xyz + 3 * column + 1, hit, 0.0)
        dz = z - tl.load(xyz + 3 * column + 2, hit, 0.0)
        hit &= dx * dx + dy * dy + dz * dz <= tl.full((1, 1), SQUARED, x.dtype)
        column = tl.where(hit, column, _NO_ROW)
        first = tl.minimum(first, tl.min(column, 1))
        hits = store_hits(idx, row, column, hit, hits, samples)
        low = tl.where(tl.min(hits, 0) < samples, low + LINES, lines)
    _repeat_first(idx, empty, row, first, hits, inside, samples, LANES)


@triton.jit(do_not_specialize=["rows"])
def _nearest_kernel(
    points, ends, places, place_ends, squared, idx, frames, rows,
    ROWS: tl.constexpr, LANES: tl.constexpr,
):  # fmt: skip
    row = tl.program_id(0) * ROWS + tl.arange(0, ROWS)
    inside = row < rows
    start, stop = range_in_frame(row, ends, place_ends, frames)
    x = tl.load(points + 3 * row, inside, 0.0)[:, None]
    y = tl.load(points + 3 * row + 1, inside, 0.0)[:, None]
    z = tl.load(points + 3 * row + 2, inside, 0.0)[:, None]
    # The three nearest of each lane's places, then those of all lanes.
    d0 = tl.full((ROWS, LANES), float("inf"), x.dtype)
    d1, d2 = d0, d0
    i0 = tl.zeros((ROWS, LANES), tl.int32)
    i1, i2 = i0, i0
    high = tl.max(stop, 0)
    for low in range(tl.min(tl.where(start < stop, start, _NO_ROW), 0), high, LANES):
        column = low + tl.arange(0, LANES)
        is_place = column < high
        dx = x - tl.load(places + 3 * column, is_place, 0.0)[None, :]
        dy = y - tl.load(places + 3 * column + 1, is_place, 0.0)[None, :]
        dz = z - tl.load(places + 3 * column + 2, is_place, 0.0)[None, :]
        column = column[None, :]
        is_candidate = (column >= start[:, None]) & (column < stop[:, None])
        distance = tl.where(is_candidate, dx * dx + dy * dy + dz * dz, float("inf"))
        first, second, third = distance < d0, distance < d1, distance < d2
        d2, i2 = _insert(third, second, distance, column, d1, i1, d2, i2)
        d1, i1 = _insert(second, first, distance, column, d0, i0, d1, i1)
        d0, i0 = tl.where(first, distance, d0), tl.where(first, column, i0)
    for k in tl.static_range(3):
        least = tl.min(d0, 1)
        is_tied = d0 == least[:, None]
        nearest = tl.min(tl.where(is_tied, i0, _NO_ROW), 1)
        tl.store(squared + 3 * row + k, least, inside)
        tl.store(idx + 3 * row + k, tl.where(least < float("inf"), nearest, 0).to(tl.int64), inside)
        taken = is_tied & (i0 == nearest[:, None])
        d0, i0 = tl.where(taken, d1, d0), tl.where(taken, i1, i0)
        d1, i1 = tl.where(taken, d2, d1), tl.where(taken, i2, i1)
        d2 = tl.where(taken, float("inf"), d2)


@triton.jit
def _insert(enters, passes, distance, column, better, better_row, worse, worse_row):
    """Distances and rows of a rank: the better rank's where the new one passes that, too."""
    moved, moved_row = tl.where(passes, better, distance), tl.where(passes, better_row, column)
    return tl.where(enters, moved, worse), tl.where(enters, moved_row, worse_row)

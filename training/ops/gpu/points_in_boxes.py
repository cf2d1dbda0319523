"""Points and boxes that contain them, a program for a block of points or of boxes.

Frames are stacked as in `neighbours`."""

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.ops.gpu.launch import launch
from training.ops.gpu.neighbours import _NO_ROW, range_in_frame, store_hits

_POINTS, _BOXES = 64, 64  # points of a program that looks for their boxes, boxes in one go
_ROIS, _TILE = 4, 1024  # boxes of a program that looks for their points, points in one go


def first_boxes(
    points: Tensor, counts: Tensor, boxes: Tensor, box_counts: Tensor, margin: float
) -> Tensor:
    """Find the first box of its frame in which each point lies, (N,) int64; see `box_of_points`."""
    box = torch.empty(len(points), dtype=torch.int64, device=points.device)
    stacks = points, points.stride(0), counts.cumsum(0), boxes.contiguous(), box_counts.cumsum(0)
    programs, sizes = triton.cdiv(len(points), _POINTS), (len(counts), len(points))
    blocks = {"POINTS": _POINTS, "BOXES": _BOXES}
    launch(_box_kernel, programs, *stacks, box, *sizes, warps=8, MARGIN=margin, **blocks)
    return box


def first_points(
    points: Tensor, counts: Tensor, boxes: Tensor, box_counts: Tensor, samples: int, margin: float
) -> tuple[Tensor, Tensor]:
    """Find rows (M, samples) of the first points of its frame in each box, then 0.

    And the number of these points, (M,) int32."""
    idx = torch.zeros(len(boxes), samples, dtype=torch.int64, device=points.device)
    hits = torch.empty(len(boxes), dtype=torch.int32, device=points.device)
    stacks = points, points.stride(0), counts.cumsum(0), boxes.contiguous(), box_counts.cumsum(0)
    programs, sizes = triton.cdiv(len(boxes), _ROIS), (len(counts), len(boxes), samples)
    blocks = {"ROIS": _ROIS, "TILE": _TILE}
    launch(_point_kernel, programs, *stacks, idx, hits, *sizes, MARGIN=margin, **blocks)
    return idx, hits


@triton.jit
def _load_point(points, stride, row, mask):
    place = points + row.to(tl.int64) * stride
    return tl.load(place, mask, 0.0), tl.load(place + 1, mask, 0.0), tl.load(place + 2, mask, 0.0)


@triton.jit
def _load_box(boxes, row, mask, MARGIN: tl.constexpr):
    """Centre, half the size, with the margin at the sides, cosine and sine of the yaw."""
    x = tl.load(boxes + 7 * row, mask, 0.0)
    y = tl.load(boxes + 7 * row + 1, mask, 0.0)
    z = tl.load(boxes + 7 * row + 2, mask, 0.0)
    margin = tl.full((1,), MARGIN, x.dtype)
    length = tl.load(boxes + 7 * row + 3, mask, 0.0) * 0.5 + margin
    width = tl.load(boxes + 7 * row + 4, mask, 0.0) * 0.5 + margin
    height = tl.load(boxes + 7 * row + 5, mask, 0.0) * 0.5
    yaw = tl.load(boxes + 7 * row + 6, mask, 0.0).to(tl.float64)
    return x, y, z, length, width, height, tl.cos(yaw).to(x.dtype), tl.sin(yaw).to(x.dtype)


@triton.jit
def _is_inside(dx, dy, dz, length, width, height, cosine, sine):
    along = tl.abs(dx * cosine + dy * sine) < length
    across = tl.abs(dy * cosine - dx * sine) < width
    return along & across & (tl.abs(dz) <= height)


@triton.jit(do_not_specialize=["rows"])
def _box_kernel(
    points, stride, ends, boxes, box_ends, box, frames, rows,
    MARGIN: tl.constexpr, POINTS: tl.constexpr, BOXES: tl.constexpr,
):  # fmt: skip
    row = tl.program_id(0) * POINTS + tl.arange(0, POINTS)
    inside = row < rows
    start, stop = range_in_frame(row, ends, box_ends, frames)
    px, py, pz = _load_point(points, stride, row, inside)
    first = tl.full((POINTS,), _NO_ROW, tl.int32)
    high = tl.max(stop, 0)
    for low in range(tl.min(tl.where(start < stop, start, _NO_ROW), 0), high, BOXES):
        column = low + tl.arange(0, BOXES)
        x, y, z, length, width, height, cosine, sine = _load_box(
            boxes, column, column < high, MARGIN
        )
        dx, dy, dz = px[:, None] - x[None, :], py[:, None] - y[None, :], pz[:, None] - z[None, :]
        sizes = length[None, :], width[None, :], height[None, :]
        hit = _is_inside(dx, dy, dz, sizes[0], sizes[1], sizes[2], cosine[None, :], sine[None, :])
        hit &= (column[None, :] >= start[:, None]) & (column[None, :] < stop[:, None])
        first = tl.minimum(first, tl.min(tl.where(hit, column[None, :], _NO_ROW), 1))
    tl.store(box + row, tl.where(first < _NO_ROW, first, -1).to(tl.int64), inside)


@triton.jit(do_not_specialize=["rows"])
def _point_kernel(
    points, stride, ends, boxes, box_ends, idx, number, frames, rows, samples,
    MARGIN: tl.constexpr, ROIS: tl.constexpr, TILE: tl.constexpr,
):  # fmt: skip
    row = tl.program_id(0) * ROIS + tl.arange(0, ROIS)
    inside = row < rows
    start, stop = range_in_frame(row, box_ends, ends, frames)
    x, y, z, length, width, height, cosine, sine = _load_box(boxes, row, inside, MARGIN)
    hits = tl.where(inside, 0, samples)
    low = tl.min(tl.where(start < stop, start, _NO_ROW), 0)
    high = tl.max(stop, 0)
    while low < high:
        column = low + tl.arange(0, TILE)
        px, py, pz = _load_point(points, stride, column, column < high)
        dx, dy, dz = px[None, :] - x[:, None], py[None, :] - y[:, None], pz[None, :] - z[:, None]
        sizes = length[:, None], width[:, None], height[:, None]
        hit = _is_inside(dx, dy, dz, sizes[0], sizes[1], sizes[2], cosine[:, None], sine[:, None])
        hit &= (column[None, :] >= start[:, None]) & (column[None, :] < stop[:, None])
        columns = tl.broadcast_to(column[None, :], (ROIS, TILE))
        hits = store_hits(idx, row, columns, hit, hits, samples)
        low = tl.where(tl.min(hits, 0) < samples, low + TILE, high)
    tl.store(number + row, tl.minimum(hits, samples), inside)

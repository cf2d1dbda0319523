"""Furthest point sampling, a program for each frame."""

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.ops.gpu.launch import launch

_LANES = 4096


def furthest_rows(xyz: Tensor, starts: Tensor, sizes: Tensor, samples: int, largest: int) -> Tensor:
    """Choose rows of frames that have points, counted within the frame, (B, samples) int64.

    Points (N, 3), of which frame b has `sizes[b]` from row `starts[b]` on. With fewer points than
    samples its rows repeat."""
    rows = torch.zeros(len(sizes), samples, dtype=torch.int64, device=xyz.device)
    distance = xyz.new_full((len(xyz),), torch.inf)
    arguments = (xyz.T.contiguous(), starts, sizes, distance, rows, samples, len(xyz))
    lanes = min(_LANES, max(128, triton.next_power_of_2(largest)))
    launch(_furthest_kernel, len(sizes), *arguments, warps=max(1, lanes // 128), LANES=lanes)
    return rows.gather(1, torch.arange(samples, device=xyz.device) % sizes[:, None])


@triton.jit(do_not_specialize=["total"])
def _furthest_kernel(xyz, starts, sizes, distance, rows, samples, total, LANES: tl.constexpr):
    frame = tl.program_id(0)
    count = tl.load(sizes + frame).to(tl.int32)
    first = tl.load(starts + frame)
    xs = xyz + first
    ys = xs + total
    zs = ys + total
    distance += first
    rows += frame.to(tl.int64) * samples
    lanes = tl.arange(0, LANES)
    newest = 0
    for sample in range(1, tl.minimum(samples, count)):
        x = tl.load(xs + newest)
        y = tl.load(ys + newest)
        z = tl.load(zs + newest)
        # The furthest of each lane's points, then that of all lanes.
        furthest = tl.full((LANES,), -1.0, x.dtype)
        place = tl.full((LANES,), 0x7FFFFFFF, tl.int32)
        for low in range(0, count, LANES):
            row = low + lanes
            inside = row < count
            dx = tl.load(xs + row, inside, 0.0) - x
            dy = tl.load(ys + row, inside, 0.0) - y
            dz = tl.load(zs + row, inside, 0.0) - z
            squared = dx * dx + dy * dy + dz * dz
            nearest = tl.minimum(squared, tl.load(distance + row, inside, -1.0))
            tl.store(distance + row, nearest, inside)
            order = _place_of(row)
            better = (nearest > furthest) | ((nearest == furthest) & (order < place))
            furthest = tl.where(inside & better, nearest, furthest)
            place = tl.where(inside & better, order, place)
        chosen = tl.min(tl.where(furthest == tl.max(furthest, 0), place, 0x7FFFFFFF), 0)
        newest = (chosen & 0x1FFFFF) << 10 | _backwards(chosen >> 21)
        tl.store(rows + sample, newest)


@triton.jit
def _place_of(row):
    """Place among equally far rows, the first of which is chosen, as `_tie_order` sorts them."""
    return _backwards(row & 0x3FF) << 21 | row >> 10


@triton.jit
def _backwards(number):
    """Reverse the lowest ten bits of a number below 1024."""
    number = (number & 0x5555) << 1 | (number >> 1) & 0x5555
    number = (number & 0x3333) << 2 | (number >> 2) & 0x3333
    number = (number & 0x0F0F) << 4 | (number >> 4) & 0x0F0F
    number = (number & 0x00FF) << 8 | number >> 8
    return number >> 6

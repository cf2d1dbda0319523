"""Tables of sparse convolutions: the windows that sites reach, and the sites in each window."""

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.ops.gpu.bisection import count_up_to
from training.ops.gpu.launch import launch

Triple = tuple[int, int, int]  # along z, y, x

_LANES = 1024
"""Windows, or sites, of a program."""


def tables(keys: Tensor, starts: Tensor, extents: Triple, kernel: Triple) -> tuple[Tensor, Tensor]:
    """Find the site at each place of each window, and the window with each site at each place.

    Sorted keys of the sites (N,) and of the windows' first places (M,), int64. Returns tables
    (K, M) and (K, N), int32, -1 for none."""
    positions = kernel[0] * kernel[1] * kernel[2]
    inputs = torch.empty(positions, len(starts), dtype=torch.int32, device=keys.device)
    outputs = torch.full((positions, len(keys)), -1, dtype=torch.int32, device=keys.device)
    programs = triton.cdiv(inputs.numel(), _LANES)
    sizes = (len(keys), len(starts), *extents[1:], *kernel)
    launch(_table_kernel, programs, keys, starts, inputs, outputs, *sizes, LANES=_LANES)
    return inputs, outputs


def window_starts(
    coordinates: Tensor,
    extents: Triple,
    counts: Triple,
    kernel: Triple,
    stride: Triple,
    padding: Triple,
) -> Tensor:
    """Keys of the first places of windows that hold a site (N, 4), int64, in no order.

    At least one entry is that of no window, the largest number."""
    reach = [(size - 1) // step + 1 for size, step in zip(kernel, stride, strict=True)]
    most = reach[0] * reach[1] * reach[2]
    starts = coordinates.new_empty(len(coordinates) * most + 1)
    sizes = (len(coordinates), *extents, *counts, *reach, *kernel, *stride, *padding)
    programs = triton.cdiv(len(starts), _LANES)
    launch(_start_kernel, programs, coordinates.contiguous(), starts, *sizes, warps=8, LANES=_LANES)
    return starts


@triton.jit(do_not_specialize=["sites", "count"])
def _table_kernel(
    keys, starts, inputs, outputs, sites, count, extent_y, extent_x,
    kernel_z, kernel_y, kernel_x, LANES: tl.constexpr,
):  # fmt: skip
    entry = tl.program_id(0) * LANES + tl.arange(0, LANES)
    position, start = entry // count, entry % count
    inside = position < kernel_z * kernel_y * kernel_x
    plane = position // kernel_x
    step = (plane // kernel_y * extent_y + plane % kernel_y) * extent_x + position % kernel_x
    wanted = tl.load(starts + start) + step
    site = count_up_to(keys, wanted, sites) - 1
    hit = inside & (tl.load(keys + site, site >= 0, -1) == wanted)
    tl.store(inputs + entry, tl.where(hit, site, -1), inside)
    tl.store(outputs + position * sites + site, start, hit)


@triton.jit(do_not_specialize=["sites"])
def _start_kernel(
    coordinates, starts, sites, extent_z, extent_y, extent_x, count_z, count_y, count_x,
    reach_z, reach_y, reach_x, kernel_z, kernel_y, kernel_x, stride_z, stride_y, stride_x,
    padding_z, padding_y, padding_x, LANES: tl.constexpr,
):  # fmt: skip
    most = reach_z * reach_y * reach_x
    entry = tl.program_id(0) * LANES + tl.arange(0, LANES)
    inside = entry < sites * most
    cells = coordinates + entry // most * 4
    z = tl.load(cells + 1, inside, 0) + padding_z
    y = tl.load(cells + 2, inside, 0) + padding_y
    x = tl.load(cells + 3, inside, 0) + padding_x
    window_z = z // stride_z - entry // reach_x // reach_y % reach_z
    window_y = y // stride_y - entry // reach_x % reach_y
    window_x = x // stride_x - entry % reach_x
    fits = (window_z >= 0) & (window_z < count_z) & (z - window_z * stride_z < kernel_z)
    fits &= (window_y >= 0) & (window_y < count_y) & (y - window_y * stride_y < kernel_y)
    fits &= (window_x >= 0) & (window_x < count_x) & (x - window_x * stride_x < kernel_x)
    start = tl.load(cells, inside, 0) * extent_z + window_z * stride_z
    start = (start * extent_y + window_y * stride_y) * extent_x + window_x * stride_x
    none = 0x7FFFFFFFFFFFFFFF
    tl.store(starts + entry, tl.where(inside & fits, start, none), entry <= sites * most)

"""Sparse convolution as products of matrices whose rows are gathered on the way."""

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.ops.gpu.launch import launch

_ROWS, _OUTPUTS = 64, 32
"""Largest block of a product: output rows, and channels of the output."""
_PORTION = 4096
"""Output rows over which one program sums the gradient of weights."""


def convolve(features: Tensor, weight: Tensor, table: Tensor) -> Tensor:
    """Sum the products of weights and features over the positions of the kernel.

    Features (N, in), weights (out, K, in), rows of the features (K, M), int32, -1 for none.
    Returns (M, out). Sums of 16-bit floats are in float32."""
    rows, blocks = table.shape[1], _blocks(*weight.shape)
    result = features.new_empty(rows, len(weight))
    arguments = (features.contiguous(), weight, table, result, rows, *weight.shape)
    programs = triton.cdiv(rows, _ROWS) * triton.cdiv(len(weight), blocks["OUTPUTS"])
    launch(_convolution_kernel, programs, *arguments, *weight.stride(), **blocks)
    return result


def weight_gradient(features: Tensor, gradient: Tensor, table: Tensor) -> Tensor:
    """Gradient of the weights, (out, K, in), from that of the result, (M, out).

    The order of sums depends on the sizes alone."""
    sizes = gradient.shape[1], len(table), features.shape[1]
    rows, blocks = table.shape[1], _blocks(*sizes)
    portions = triton.cdiv(rows, _PORTION)
    wide = torch.promote_types(features.dtype, torch.float32)
    sums = features.new_empty(portions, *sizes, dtype=wide)
    arguments = (features.contiguous(), gradient.contiguous(), table, sums, rows, *sizes)
    programs = portions * len(table) * triton.cdiv(sizes[0], blocks["OUTPUTS"])
    launch(_gradient_kernel, programs, *arguments, PORTION=_PORTION, **blocks)
    return sums.sum(dim=0).to(features.dtype)


def _blocks(outputs: int, positions: int, inputs: int) -> dict[str, int]:
    """Sizes of blocks; a product on tensor cores has at least 16 of each."""
    in_block, out_block = (max(16, triton.next_power_of_2(size)) for size in (inputs, outputs))
    return {"ROWS": _ROWS, "INPUTS": in_block, "OUTPUTS": min(_OUTPUTS, out_block)}


@triton.jit(do_not_specialize=["rows"])
def _convolution_kernel(
    features, weight, table, result, rows, outputs, positions, inputs, of_output, of_position,
    of_input, ROWS: tl.constexpr, INPUTS: tl.constexpr, OUTPUTS: tl.constexpr,
):  # fmt: skip
    tiles = (outputs + OUTPUTS - 1) // OUTPUTS
    row = tl.program_id(0) // tiles * ROWS + tl.arange(0, ROWS)[:, None]
    output = tl.program_id(0) % tiles * OUTPUTS + tl.arange(0, OUTPUTS)
    channel = tl.arange(0, INPUTS)
    inside = row < rows
    real = (channel[:, None] < inputs) & (output < outputs)
    weight += channel[:, None] * of_input + output * of_output
    wide = tl.float64 if features.dtype.element_ty == tl.float64 else tl.float32
    total = tl.full((ROWS, OUTPUTS), 0, wide)
    for _ in range(positions):
        source = tl.load(table + row, inside, -1)
        hit = source >= 0
        if tl.max(source) >= 0:
            near = tl.load(features + (source * inputs + channel), hit & (channel < inputs), 0.0)
            total = tl.dot(near, tl.load(weight, real, 0.0), total, "ieee", out_dtype=wide)
        table += rows
        weight += of_position
    tl.store(result + (row * outputs + output), total, inside & (output < outputs))


@triton.jit(do_not_specialize=["rows"])
def _gradient_kernel(
    features, gradient, table, sums, rows, outputs, positions, inputs,
    PORTION: tl.constexpr, ROWS: tl.constexpr, INPUTS: tl.constexpr, OUTPUTS: tl.constexpr,
):  # fmt: skip
    tiles = (outputs + OUTPUTS - 1) // OUTPUTS
    position = tl.program_id(0) // tiles % positions
    portion = tl.program_id(0) // tiles // positions
    output = tl.program_id(0) % tiles * OUTPUTS + tl.arange(0, OUTPUTS)
    channel = tl.arange(0, INPUTS)
    table += position * rows
    wide = tl.float64 if features.dtype.element_ty == tl.float64 else tl.float32
    total = tl.full((OUTPUTS, INPUTS), 0, wide)
    for first in range(portion * PORTION, tl.minimum(rows, (portion + 1) * PORTION), ROWS):
        row = first + tl.arange(0, ROWS)[:, None]
        source = tl.load(table + row, row < rows, -1)
        hit = source >= 0
        if tl.max(source) >= 0:
            near = tl.load(features + (source * inputs + channel), hit & (channel < inputs), 0.0)
            of_row = tl.load(gradient + (row * outputs + output), hit & (output < outputs), 0.0)
            total = tl.dot(tl.trans(of_row), near, total, "ieee", out_dtype=wide)
    place = ((portion * outputs + output[:, None]) * positions + position) * inputs + channel
    tl.store(sums + place, total, (output[:, None] < outputs) & (channel < inputs))

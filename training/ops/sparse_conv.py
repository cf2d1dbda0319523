"""Sparse 3D convolution: only sites that hold a feature vector are stored and computed.

Graham et al., 3D semantic segmentation with submanifold sparse convolutional networks, CVPR 2018.
For every position of the kernel the input rows that take part are gathered and multiplied by that
position's weights; then every output row sums its products. The sum is taken in a fixed order, so
that the result is the same in every run, on a GPU too."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd.function import FunctionCtx, once_differentiable
from torch.nn import functional

from lidarplace.base.errors import InputError
from training.ops.sparse_rules import Rules, Triple, output_shape, strided_rules, submanifold_rules


@dataclass(frozen=True)
class SparseTensor:
    """Feature vectors at some sites of a grid; all others are zero."""

    features: Tensor  # shape (N, C)
    coordinates: Tensor  # frame, z, y, x of each row, sorted, none twice, shape (N, 4), int64
    shape: Triple  # cells of the grid along z, y, x
    frames: int  # number of frames
    # Pairs of the submanifold convolutions on these sites, by kernel; shared by tensors with these
    tables: dict[Triple, Rules] = field(default_factory=dict, repr=False, compare=False)

    def with_features(self, features: Tensor) -> "SparseTensor":
        """Replace the features, (N, C'), at the same sites."""
        return replace(self, features=features)

    def bev(self) -> Tensor:
        """View from above, heights stacked as channels c * nz + z: (frames, C * nz, ny, nx)."""
        nz, ny, nx = self.shape
        frame, z, y, x = self.coordinates.unbind(dim=1)
        # Channels last in memory, which convolutions on a CPU like better.
        image = self.features.new_zeros(self.frames, ny, nx, self.features.shape[1], nz)
        image = image.permute(0, 1, 2, 4, 3).index_put((frame, y, x, z), self.features)
        return image.permute(0, 1, 2, 4, 3).flatten(3).permute(0, 3, 1, 2)


class _Convolution(torch.autograd.Function):
    """Convolution of input rows (N, in) by weights (out, K, in) and a table of pairs.

    The gathered rows are not kept for the backward pass: they are many times the input."""

    @staticmethod
    def forward(ctx: FunctionCtx, features: Tensor, weight: Tensor, rules: Rules) -> Tensor:
        ctx.save_for_backward(features, weight)
        ctx.rules = rules  # type: ignore[attr-defined]
        products = features.new_empty(len(rules.inputs), len(weight))
        split = (part.split(rules.counts) for part in (rules.inputs, products))
        for matrix, rows, product in zip(weight.unbind(dim=1), *split, strict=True):
            torch.mm(features.index_select(0, rows), matrix.t(), out=product)
        return _segment_sum(products, *rules.by_output)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, Tensor, None]:
        features, weight = ctx.saved_tensors
        rules: Rules = ctx.rules
        wanted = ctx.needs_input_grad[0]
        products = features.new_empty(len(rules.inputs) if wanted else 0, features.shape[1])
        weight_grad = weight.new_empty(weight.shape[1], weight.shape[0], weight.shape[2])
        first = 0
        for k, count in enumerate(rules.counts):
            pairs = slice(first, first + count)
            output_grad = grad.index_select(0, rules.outputs[pairs])
            rows = features.index_select(0, rules.inputs[pairs])
            torch.mm(output_grad.t(), rows, out=weight_grad[k])
            if wanted:
                torch.mm(output_grad, weight[:, k], out=products[pairs])
            first += count
        weight_grad = weight_grad.transpose(0, 1).contiguous()
        return (_segment_sum(products, *rules.by_input) if wanted else None), weight_grad, None


def _segment_sum(rows: Tensor, order: Tensor, starts: Tensor) -> Tensor:
    """Sums of rows[order[starts[i] : starts[i + 1]]], shape (len(starts) - 1, C)."""
    if len(order) == 0:
        return rows.new_zeros(len(starts) - 1, rows.shape[1])
    return functional.embedding_bag(order, rows, starts, mode="sum", include_last_offset=True)


class _SparseConvolution(nn.Module):
    """Weights (out, kz, ky, kx, in) without bias, the layout of spconv 2."""

    def __init__(self, inputs: int, outputs: int, kernel: Triple) -> None:
        super().__init__()
        self.kernel = kernel
        bound = 1 / math.sqrt(inputs * math.prod(kernel))
        self.weight = nn.Parameter(torch.empty(outputs, *kernel, inputs).uniform_(-bound, bound))

    def _convolve(self, features: Tensor, rules: Rules) -> Tensor:
        weight = self.weight.flatten(1, 3)
        device = features.device.type
        if torch.is_autocast_enabled(device):
            dtype = torch.get_autocast_dtype(device)
            features, weight = features.to(dtype), weight.to(dtype)
        convolved: Tensor = _Convolution.apply(features, weight, rules)
        return convolved


class SubmanifoldConv3d(_SparseConvolution):
    """A convolution with stride 1 whose output has exactly the sites of its input.

    Raises ValueError: a size of the kernel is even."""

    def __init__(self, inputs: int, outputs: int, kernel: Triple = (3, 3, 3)) -> None:
        if any(size % 2 == 0 for size in kernel):
            raise InputError(key="kernel", expected="odd sizes", found=kernel)
        super().__init__(inputs, outputs, kernel)

    def forward(self, x: SparseTensor) -> SparseTensor:
        """(N, inputs) to (N, outputs)."""
        if self.kernel not in x.tables:
            x.tables[self.kernel] = submanifold_rules(x.coordinates, x.shape, self.kernel)
        return x.with_features(self._convolve(x.features, x.tables[self.kernel]))


class SparseConv3d(_SparseConvolution):
    """A convolution whose output has every site that some site of its input reaches."""

    def __init__(
        self, inputs: int, outputs: int, kernel: Triple, stride: Triple, padding: Triple
    ) -> None:
        super().__init__(inputs, outputs, kernel)
        self.geometry = (kernel, stride, padding)

    def forward(self, x: SparseTensor) -> SparseTensor:
        """(N, inputs) to (M, outputs) on the coarser grid."""
        rules, coordinates = strided_rules(x.coordinates, x.shape, *self.geometry)
        features = self._convolve(x.features, rules)
        return SparseTensor(features, coordinates, output_shape(x.shape, *self.geometry), x.frames)

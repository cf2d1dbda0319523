"""Sparse 3D convolution: only sites that hold a feature vector are stored and computed.

Graham et al., 3D semantic segmentation with submanifold sparse convolutional networks, CVPR 2018.
For every position of the kernel the input rows that take part are gathered and multiplied by that
position's weights, and every output row sums its products: in a fixed order, so that the result is
the same in every run, on a GPU too."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.autograd.function import FunctionCtx, once_differentiable

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import inner, njit
from training.ops.sparse_rules import Rules, Triple, Windows, strided_rules, submanifold_rules

_PORTION = 256
"""Pairs that a CPU gathers at once."""


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
    """Convolution of input rows (N, in) by weights (out, K, in) and tables of pairs."""

    @staticmethod
    def forward(ctx: FunctionCtx, features: Tensor, weight: Tensor, rules: Rules) -> Tensor:
        ctx.save_for_backward(features, weight)
        ctx.rules = rules  # type: ignore[attr-defined]
        return _operations(features)[0](features, weight, rules.inputs)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, Tensor, None]:
        features, weight = ctx.saved_tensors
        convolve, weight_gradient = _operations(features)
        of_weight = weight_gradient(features, grad, ctx.rules.inputs)
        if not ctx.needs_input_grad[0]:
            return None, of_weight, None
        return convolve(grad, weight.transpose(0, 2), ctx.rules.outputs), of_weight, None


def _operations(features: Tensor) -> tuple[Callable[..., Tensor], Callable[..., Tensor]]:
    """Convolution of features by weights and a table, and the weights' gradient."""
    if features.is_cpu:
        return _convolve_numba, _weight_gradient_numba
    from training.ops.gpu.sparse_conv import convolve, weight_gradient

    return convolve, weight_gradient


def _convolve_numba(features: Tensor, weight: Tensor, table: Tensor) -> Tensor:
    matrices = weight.permute(1, 2, 0).contiguous()
    arrays = (item.contiguous().numpy() for item in (features, matrices, table))
    return torch.from_numpy(_convolution_kernel(*arrays))


def _weight_gradient_numba(features: Tensor, grad: Tensor, table: Tensor) -> Tensor:
    arrays = (item.contiguous().numpy() for item in (features, grad, table))
    return torch.from_numpy(_gradient_kernel(*arrays)).transpose(0, 1).contiguous()


@njit(cache=True)
def _convolution_kernel(features, weight, table):
    """Rows (M, out) from features (N, in), weights (K, in, out) and a table (K, M) of their rows.

    The product is of portions of the pairs at a position, which fit the processor's cache."""
    positions, inputs, outputs = weight.shape
    result = np.zeros((table.shape[1], outputs), features.dtype)
    pairs = np.empty(table.shape[1], np.int64)
    rows = np.empty((_PORTION, inputs), features.dtype)
    products = np.empty((_PORTION, outputs), features.dtype)
    for k in range(positions):
        count = _pairs(table[k], pairs)
        for first in range(0, count, _PORTION):
            portion = pairs[first : min(first + _PORTION, count)]
            _gather(features, table[k], portion, rows)
            np.dot(rows[: len(portion)], weight[k], products[: len(portion)])
            for i in range(len(portion)):
                row = portion[i]
                for c in range(outputs):
                    result[row, c] += products[i, c]
    return result


@njit(cache=True)
def _gradient_kernel(features, grad, table):
    """Gradient (K, out, in) of the weights."""
    inputs, outputs = features.shape[1], grad.shape[1]
    result = np.zeros((len(table), outputs, inputs), features.dtype)
    pairs = np.empty(table.shape[1], np.int64)
    rows = np.empty((_PORTION, inputs), features.dtype)
    grads = np.empty((_PORTION, outputs), features.dtype)
    product = np.empty((outputs, inputs), features.dtype)
    for k in range(len(table)):
        count = _pairs(table[k], pairs)
        for first in range(0, count, _PORTION):
            portion = pairs[first : min(first + _PORTION, count)]
            _gather(features, table[k], portion, rows)
            for i in range(len(portion)):
                for c in range(outputs):
                    grads[i, c] = grad[portion[i], c]
            np.dot(grads[: len(portion)].T, rows[: len(portion)], product)
            result[k] += product
    return result


@inner
def _gather(features, sources, portion, rows):
    """Fill `rows` with the features of the `sources` of a portion."""
    for i in range(len(portion)):
        source = sources[portion[i]]
        for c in range(features.shape[1]):
            rows[i, c] = features[source, c]


@inner
def _pairs(table, rows):
    """Number of rows (M,) that have an entry, and these rows, the first of `rows`."""
    count = 0
    for i in range(len(table)):
        rows[count] = i
        count += table[i] >= 0
    return count


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
        # On a CPU in 32 bits: it multiplies small matrices.
        if device != "cpu" and torch.is_autocast_enabled(device):
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
        windows = Windows(x.shape, *self.geometry)
        rules, coordinates = strided_rules(x.coordinates, windows)
        return SparseTensor(
            self._convolve(x.features, rules), coordinates, windows.counts, x.frames
        )

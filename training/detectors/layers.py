"""Layers on rows (N, C) that several networks share."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional


class PaddedBatchNorm(nn.BatchNorm1d):
    """Batch norm over rows of which a known number is zero and not stored."""

    def forward(self, rows: Tensor, zeros: int = 0) -> Tensor:
        """Normalise `rows` (N, C); `zeros` further rows count in the statistics of training."""
        total = len(rows) + zeros
        if self.training and total < 2:  # one point in the whole batch has no variance
            return functional.batch_norm(
                rows, self.running_mean, self.running_var, self.weight, self.bias, eps=self.eps
            )
        if not self.training or zeros == 0:
            return super().forward(rows)
        mean = rows.sum(dim=0) / total
        variance = ((rows - mean).square().sum(dim=0) + zeros * mean.square()) / total
        self.follow(mean, variance, total)
        return (rows - mean) * torch.rsqrt(variance + self.eps) * self.weight + self.bias

    @torch.no_grad()
    def follow(self, mean: Tensor, variance: Tensor, rows: int) -> None:
        """Move the running statistics towards those (C,) of a batch of so many rows."""
        assert self.running_mean is not None
        assert self.running_var is not None
        assert self.momentum is not None
        assert self.num_batches_tracked is not None
        self.running_mean.lerp_(mean.to(self.running_mean), self.momentum)
        unbiased = variance * (rows / (rows - 1))
        self.running_var.lerp_(unbiased.to(self.running_var), self.momentum)
        self.num_batches_tracked += 1


class RowConv2d(nn.Conv2d):
    """A linear layer on rows (N, C) with the weight (out, in, 1, 1) of a 1 × 1 convolution."""

    def forward(self, rows: Tensor) -> Tensor:
        """(N, in) to (N, out)."""
        return functional.linear(rows, self.weight.flatten(1), self.bias)


class RowConv1d(nn.Linear):
    """A linear layer on rows (N, C) with the weight (out, in, 1) of a 1 × 1 convolution."""

    def __init__(self, inputs: int, outputs: int, bias: bool = True) -> None:
        super().__init__(inputs, outputs, bias)
        self.weight = nn.Parameter(self.weight.detach()[..., None])

    def forward(self, rows: Tensor) -> Tensor:
        """(N, in) to (N, out)."""
        return functional.linear(rows, self.weight.flatten(1), self.bias)


def row_layers(
    inputs: int, hidden: Sequence[int], dropout: float, layer: type[nn.Linear] = RowConv1d
) -> nn.Sequential:
    """Layers with batch norm and ReLU on rows (N, inputs), dropout between them.

    They are numbered as in OpenPCDet: 0, 1, 2, dropout 3, 4, 5, 6."""
    layers: list[nn.Module] = []
    for before, after in pairwise([inputs, *hidden]):
        if layers:
            layers.append(nn.Dropout(dropout))
        linear = layer(before, after, bias=False)
        nn.init.xavier_normal_(linear.weight)
        layers += [linear, nn.BatchNorm1d(after), nn.ReLU()]
    return nn.Sequential(*layers)


def precise(rows: Tensor) -> Tensor:
    """`rows` in float32 if they have fewer digits: losses and geometry need them."""
    return rows.to(torch.promote_types(rows.dtype, torch.float32))

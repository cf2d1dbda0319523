"""Set abstraction: features of chosen places from the points around them.

PointNet++ (Qi et al., NeurIPS 2017), sections 3.2 and 3.3. Point sets are stacked: rows of one
frame after those of another, and the number of rows of each."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.detectors.layers import PaddedBatchNorm, RowConv2d
from training.ops.ball_query import ball_query
from training.ops.grouping import group


class PointMlp(nn.Sequential):
    """Layers of 1 × 1 convolution, batch norm and ReLU, on rows (N, channels[0])."""

    def __init__(self, channels: Sequence[int]) -> None:
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise(channels):
            convolution = RowConv2d(inputs, outputs, 1, bias=False)
            nn.init.kaiming_normal_(convolution.weight)
            layers += [convolution, PaddedBatchNorm(outputs), nn.ReLU(inplace=True)]
        super().__init__(*layers)

    @property
    def first(self) -> Tensor:
        """Matrix of the first convolution, (channels[1], channels[0])."""
        return cast(RowConv2d, self[0]).weight.flatten(1)

    def after_first(self, rows: Tensor) -> Tensor:
        """The rest, from the output (N, channels[1]) of the first convolution."""
        for layer in list(self)[1:]:
            rows = layer(rows)
        return rows


@dataclass(frozen=True)
class BallSettings:
    """Balls of several radii around the places of a SetAbstraction."""

    radii: tuple[float, ...]  # metres
    samples: tuple[int, ...]  # at most so many points of each ball, the first ones
    mlps: tuple[tuple[int, ...], ...]  # outputs of the layers of each PointMlp


class SetAbstraction(nn.Module):
    """Features of places: at each of several radii, a PointMlp's maximum over the points nearby.

    A point enters with its offset from the place and its `inputs`. A ball without points enters
    as one point whose offset and features are 0, as in OpenPCDet."""

    def __init__(self, inputs: int, balls: BallSettings) -> None:
        super().__init__()
        self.radii, self.samples = balls.radii, balls.samples
        self.outputs = sum(mlp[-1] for mlp in balls.mlps)
        self.mlps = nn.ModuleList(PointMlp([3 + inputs, *mlp]) for mlp in balls.mlps)

    def forward(
        self, xyz: Tensor, counts: Tensor, features: Tensor, new_xyz: Tensor, new_counts: Tensor
    ) -> Tensor:
        """Features (M, outputs) of places `new_xyz` (M, 3) from points `xyz` (N, 3).

        `counts`, `new_counts`: points and places of each frame, (B,), int64."""
        scales = []
        for radius, samples, mlp in zip(self.radii, self.samples, self.mlps, strict=True):
            assert isinstance(mlp, PointMlp)
            idx, empty = ball_query(radius, samples, xyz, counts, new_xyz, new_counts)
            offsets = group(xyz, idx) - new_xyz[:, None]
            # The convolution is linear: its part in the features is computed once for each point,
            # not once for each ball that has it. Offsets are small differences, never split.
            rows = group(functional.linear(features, mlp.first[:, 3:]), idx)
            rows += functional.linear(offsets, mlp.first[:, :3])
            rows.masked_fill_(empty[:, None, None], 0)
            rows = mlp.after_first(rows.flatten(0, 1))
            scales.append(rows.view(len(new_xyz), samples, rows.shape[1]).max(dim=1).values)
        return torch.cat(scales, dim=1)


class GlobalAbstraction(nn.Module):
    """Features of whole sets: a PointMlp's maximum over all points, with their coordinates."""

    def __init__(self, inputs: int, mlp: Sequence[int]) -> None:
        super().__init__()
        self.outputs = mlp[-1]
        self.mlps = nn.ModuleList([PointMlp([3 + inputs, *mlp])])

    def forward(self, xyz: Tensor, features: Tensor) -> Tensor:
        """Points (R, S, 3) with features (R, S, inputs) to features (R, outputs)."""
        rows: Tensor = self.mlps[0](torch.cat([xyz, features], dim=2).flatten(0, 1))
        return rows.view(*xyz.shape[:2], rows.shape[1]).max(dim=1).values

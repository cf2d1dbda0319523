"""The second stage of Voxel R-CNN (Deng et al., AAAI 2021): features of the voxels around a RoI."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.detectors.backbones.voxels import VoxelGrid
from training.detectors.heads.roi_box_coder import roi_grid
from training.detectors.heads.roi_head import RoiHead, RoiOutput, RoiSettings
from training.detectors.layers import PaddedBatchNorm, RowConv1d, RowConv2d, precise, row_layers
from training.ops.grouping import group
from training.ops.sparse_conv import SparseTensor
from training.ops.sparse_rules import Triple
from training.ops.voxel_query import OccupiedVoxels, voxel_query

STRIDES = {"x_conv2": 2, "x_conv3": 4, "x_conv4": 8}
"""Scales of the sparse backbone that are pooled, with the edge of their voxels in voxels."""


@dataclass(frozen=True, kw_only=True)
class VoxelRcnnSettings(RoiSettings):
    """Settings of a VoxelRcnnHead."""

    grid: int = 6  # places of a RoI along each of its axes
    radii: tuple[float, ...] = (0.4, 0.8, 1.6)  # of a neighbourhood, at each of STRIDES, metres
    reach: Triple = (4, 4, 4)  # voxels from a place's to the last one looked at, along z, y, x
    samples: int = 16  # voxels of a neighbourhood
    pooled: tuple[int, int] = (32, 32)  # outputs of the layers around a neighbourhood's maximum
    shared: tuple[int, ...] = (256, 256)  # outputs of the hidden layers
    cls: tuple[int, ...] = (256, 256)
    reg: tuple[int, ...] = (256, 256)
    dropout: float = 0.3  # share of the features that are zero in training


class VoxelRcnnHead(RoiHead):
    """Scores and refines RoIs from three scales of the sparse backbone.

    `channels` are those of each of STRIDES, `voxels` the finest ones."""

    def __init__(
        self, channels: Sequence[int], voxels: VoxelGrid, layers: VoxelRcnnSettings
    ) -> None:
        super().__init__(layers)
        self.voxels = voxels
        self.size = layers.grid
        self.roi_grid_pool_layers = nn.ModuleList(
            NeighbourVoxelPool(inputs, layers.pooled, radius, layers.reach, layers.samples)
            for inputs, radius in zip(channels, layers.radii, strict=True)
        )
        pooled = layers.grid**3 * layers.pooled[1] * len(STRIDES)
        shared = layers.shared[-1]
        self.shared_fc_layer = row_layers(pooled, layers.shared, layers.dropout, nn.Linear)
        self.cls_fc_layers = row_layers(shared, layers.cls, layers.dropout, nn.Linear)
        self.cls_pred_layer = nn.Linear(layers.cls[-1], 1)
        self.reg_fc_layers = row_layers(shared, layers.reg, layers.dropout, nn.Linear)
        self.reg_pred_layer = nn.Linear(layers.reg[-1], 7)
        for last, deviation in ((self.cls_pred_layer, 0.01), (self.reg_pred_layer, 0.001)):
            nn.init.normal_(last.weight, std=deviation)
            nn.init.zeros_(last.bias)

    def forward(self, rois: Tensor, scales: Mapping[str, SparseTensor]) -> RoiOutput:
        """Scores and residuals of RoIs (B, R, 7)."""
        shared = self.shared_fc_layer(self._pool(rois, scales))
        logits = self.cls_pred_layer(self.cls_fc_layers(shared))
        return RoiOutput(precise(logits), precise(self.reg_pred_layer(self.reg_fc_layers(shared))))

    def _pool(self, rois: Tensor, scales: Mapping[str, SparseTensor]) -> Tensor:
        """Features (B * R, grid³ * C) of all scales at the places of a grid in each RoI."""
        places = roi_grid(rois.flatten(0, 1), self.size).flatten(0, 1)
        edges, corner = self.voxels.edges_and_corner(places)
        cells = cells_of(places - corner, edges)
        frame = torch.arange(len(rois), device=rois.device)
        frame = frame.repeat_interleave(len(places) // len(rois))[:, None]
        features = []
        for (name, stride), layer in zip(STRIDES.items(), self.roi_grid_pool_layers, strict=True):
            voxels = scales[name]
            centres = self.voxels.centres(voxels.coordinates, stride, places.dtype)
            cell = torch.div(cells, stride, rounding_mode="floor").flip(1)
            features.append(layer(voxels, centres, places, torch.cat([frame, cell], dim=1)))
        return torch.cat(features, dim=1).view(rois.shape[:2].numel(), -1)


def cells_of(places: Tensor, size: Tensor) -> Tensor:
    """Cells (M, 3), int64, of edges `size` (3,) in which places (M, 3) from their corner lie."""
    # Not the floor of a quotient, which rounding can lift into the next cell. Far outside is
    # outside: the clamp keeps what follows within int64.
    return torch.div(places, size, rounding_mode="floor").clamp(-1e6, 1e6).long()


class NeighbourVoxelPool(nn.Module):
    """Maximum over the voxels near a place, each with its features and its offset.

    The voxel query and the accelerated local aggregation of Voxel R-CNN, sections 3.2 and 3.3: the
    first layer works on every voxel once and not on every pair of a voxel and a place. `outputs`
    are those of the first layer and of the last."""

    def __init__(
        self, inputs: int, outputs: tuple[int, int], radius: float, reach: Triple, samples: int
    ) -> None:
        super().__init__()
        self.radius, self.reach, self.samples = radius, reach, samples
        inner, outer = outputs
        # Lists of one, as OpenPCDet's, which allow for several radii.
        self.mlps_in = nn.ModuleList(
            [nn.Sequential(RowConv1d(inputs, inner, False), PaddedBatchNorm(inner))]
        )
        self.mlps_pos = nn.ModuleList(
            [nn.Sequential(RowConv2d(3, inner, 1, bias=False), PaddedBatchNorm(inner))]
        )
        self.mlps_out = nn.ModuleList(
            [nn.Sequential(RowConv1d(inner, outer, False), PaddedBatchNorm(outer), nn.ReLU())]
        )
        for mlp in (*self.mlps_in, *self.mlps_pos, *self.mlps_out):
            nn.init.kaiming_normal_(mlp[0].weight)

    def forward(
        self, voxels: SparseTensor, centres: Tensor, places: Tensor, cells: Tensor
    ) -> Tensor:
        """Features (M, outer) at places (M, 3) in the cells (M, 4) frame, z, y, x.

        From N voxels at the centres (N, 3)."""
        occupied = OccupiedVoxels(centres, voxels.coordinates, voxels.shape)
        idx, empty = voxel_query(self.reach, self.radius, self.samples, occupied, places, cells)
        features = self.mlps_in[0](voxels.features)
        offsets = group(centres, idx) - places[:, None]
        offsets = offsets.masked_fill(empty[:, None, None], 0)
        position = self.mlps_pos[0](offsets.flatten(0, 1)).view(*idx.shape, -1)
        near = group(features, idx).masked_fill(empty[:, None, None], 0)
        rows: Tensor = self.mlps_out[0](functional.relu(near + position).amax(dim=1))
        return rows

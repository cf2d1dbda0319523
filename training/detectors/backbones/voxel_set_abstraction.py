"""Voxel set abstraction: a cloud in few keypoints, with features from every scale around them.

PV-RCNN (Shi et al., CVPR 2020), section 3.2."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from training.detectors.backbones.set_abstraction import BallSettings, SetAbstraction
from training.detectors.backbones.sparse_backbone import STRIDE
from training.detectors.backbones.voxels import VoxelGrid
from training.detectors.layers import PaddedBatchNorm
from training.ops.grouping import stacked_counts
from training.ops.interpolation import interpolate
from training.ops.sampling import furthest_point_sample
from training.ops.sparse_conv import SparseTensor

SCALES = {"x_conv1": 1, "x_conv2": 2, "x_conv3": 4, "x_conv4": 8}
"""Scales of the sparse backbone, with the edge of their voxels in voxels of the grid."""


@dataclass(frozen=True)
class KeypointSettings:
    """Settings of a VoxelSetAbstraction."""

    keypoints: int  # of each frame
    raw_points: BallSettings  # balls of points
    scales: tuple[BallSettings, ...]  # balls of voxels, for each of SCALES
    outputs: int  # features of a keypoint


@dataclass(frozen=True)
class Keypoints:
    """Keypoints of a batch, frame after frame."""

    xyz: Tensor  # shape (K, 3), metres
    counts: Sequence[int]  # keypoints of each frame; 0 in a frame without points
    sources: Tensor  # features from all sources side by side, shape (K, C)
    features: Tensor  # the same fused, shape (K, outputs)


class VoxelSetAbstraction(nn.Module):
    """Keypoints by furthest point sampling; features from the image, the points and the voxels.

    The finest voxels are those of `grid`, `channels` those of SCALES, `bev` those of the image."""

    def __init__(
        self, settings: KeypointSettings, grid: VoxelGrid, channels: Sequence[int], bev: int
    ) -> None:
        super().__init__()
        self.keypoints, self.grid = settings.keypoints, grid
        layers = [SetAbstraction(*of) for of in zip(channels, settings.scales, strict=True)]
        self.SA_layers = nn.ModuleList(layers)
        self.SA_rawpoints = SetAbstraction(1, settings.raw_points)
        self.inputs = bev + sum(layer.outputs for layer in (self.SA_rawpoints, *layers))
        self.vsa_point_feature_fusion = nn.Sequential(
            nn.Linear(self.inputs, settings.outputs, bias=False),
            PaddedBatchNorm(settings.outputs),
            nn.ReLU(),
        )

    def forward(
        self, points: Tensor, counts: Sequence[int], scales: Mapping[str, SparseTensor], bev: Tensor
    ) -> Keypoints:
        """Keypoints of points (N, 4), float32, finite and in the range, `counts` of each frame.

        `scales` are SCALES of the sparse backbone, `bev` (B, bev, ny, nx) the encoded grid from
        above."""
        rows, keypoint_counts = furthest_point_sample(points[:, :3], counts, self.keypoints)
        points = points.to(next(self.parameters()).dtype)
        xyz = points[:, :3].contiguous()
        keypoints = xyz[rows]
        near = keypoints, stacked_counts(keypoint_counts, xyz.device)
        frame = torch.repeat_interleave(near[1], output_size=len(keypoints))
        features = [
            sample_image(bev, frame, self._cells(keypoints)),
            self.SA_rawpoints(xyz, stacked_counts(counts, xyz.device), points[:, 3:], *near),
        ]
        for (name, stride), layer in zip(SCALES.items(), self.SA_layers, strict=True):
            voxels = scales[name]
            centres = self.grid.centres(voxels.coordinates, stride, xyz.dtype)
            # The voxels are frame after frame; a GPU's host would wait for bincount().
            frames = torch.arange(len(counts) + 1, device=xyz.device)
            voxel_counts = torch.searchsorted(voxels.coordinates[:, 0].contiguous(), frames).diff()
            features.append(layer(centres, voxel_counts, voxels.features, *near))
        sources = torch.cat(features, dim=1)
        fused = self.vsa_point_feature_fusion(sources)
        return Keypoints(keypoints, keypoint_counts, sources, fused)

    def _cells(self, xyz: Tensor) -> Tensor:
        """Places (K, 3) in cells of the image along x and y, (K, 2)."""
        low, size = self.grid.point_range, self.grid.size
        axes = ((xyz[:, axis] - low[axis]) / size[axis] / STRIDE for axis in range(2))
        return torch.stack([*axes], dim=1)


def mixed(voxels: SparseTensor) -> SparseTensor:
    """Mix the voxels of each frame in an order that depends on their places alone.

    A ball keeps its first voxels. In the order of a SparseTensor they would be its lowest ones."""
    frame, z, y, x = voxels.coordinates.unbind(dim=1)
    # Multiplicative hashing (Knuth, The art of computer programming 3).
    key = ((z << 42) + (y << 21) + x) * -7046029254386353131
    order = torch.argsort(key ^ (key >> 32), stable=True)
    order = order[torch.argsort(frame[order], stable=True)]
    features, coordinates = voxels.features[order], voxels.coordinates[order]
    return SparseTensor(features, coordinates, voxels.shape, voxels.frames)


def sample_image(image: Tensor, frame: Tensor, place: Tensor) -> Tensor:
    """Features (K, C) of an image (B, C, ny, nx) at places between its cells, bilinear.

    Places (K, 2) are in cells of their `frame` (K,). As in OpenPCDet, features lie at the cells'
    lower corners and count nothing beyond the last."""
    ny, nx = image.shape[2:]
    corners = [
        ((frame * ny + y) * nx + x, weight_x * weight_y)
        for x, weight_x in _cells_around(place[:, 0], nx)
        for y, weight_y in _cells_around(place[:, 1], ny)
    ]
    idx, weights = (torch.stack(parts, dim=1) for parts in zip(*corners, strict=True))
    rows = image.permute(0, 2, 3, 1).reshape(-1, image.shape[1])
    return interpolate(rows, idx, weights)


def _cells_around(place: Tensor, count: int) -> tuple[tuple[Tensor, Tensor], ...]:
    """Cells below and above places (K,) along an axis of `count` cells, and their weights."""
    below = place.floor().long()
    low, high = below.clamp(0, count - 1), (below + 1).clamp(0, count - 1)
    # Beyond the last cell's corner both are one cell, and the weights cancel.
    return (low, high - place), (high, place - low)

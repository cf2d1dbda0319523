"""What detectors that start from voxels share: SECOND and its two-stage descendants."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

import torch
from torch import Tensor

from training.detectors.backbones.backbone_2d import Backbone2d
from training.detectors.backbones.sparse_backbone import STRIDE, VoxelBackBone8x, encoded_height
from training.detectors.backbones.voxels import VoxelGrid, voxelise
from training.detectors.detector import Detector, PointRange, Selection
from training.detectors.heads.anchor_head import AnchorHead, HeadOutput
from training.detectors.heads.anchors import AnchorPreset, anchor_grid
from training.detectors.point_range import fitted_range
from training.ops.sparse_conv import SparseTensor


@dataclass(frozen=True)
class VoxelPreset(AnchorPreset):
    """Everything that fixes the first stage of a voxel network but its classes.

    Attributes:
        voxel: edges of a voxel along x, y, z, metres.
        max_points, max_voxels: as in VoxelGrid.
        channels: of the scales of the sparse backbone and of its result.
    """

    voxel: tuple[float, float, float]
    max_points: int | None
    max_voxels: tuple[int, int] | None
    channels: tuple[int, int, int, int, int]

    @property
    def image_stride(self) -> int:
        """Voxels along x or y per cell of the 2D backbone's image."""
        return STRIDE * self.backbone.strides[0] // self.backbone.upsample_strides[0]


@dataclass(frozen=True)
class FirstStage:
    """Results of the first stage, B frames.

    Attributes:
        scales: "x_conv1" … "x_conv4" and "encoded" of the sparse backbone.
        bev: the encoded grid from above, (B, C, ny, nx).
        image: result of the 2D backbone, (B, C2, ny, nx).
        head: raw outputs for all anchors.
    """

    scales: dict[str, SparseTensor]
    bev: Tensor
    image: Tensor
    head: HeadOutput


class VoxelDetector(Detector):
    """Voxels, a sparse 3D backbone, a 2D backbone and an anchor head.

    Args:
        classes: names of the classes, keys of the preset's anchors.
        preset: the network.
        point_range: see `fitted_range`.
        selection: the preset's way to select boxes.

    Raises:
        ValueError: the range is too low for the backbone's strides.
    """

    def __init__(
        self,
        classes: Sequence[str],
        preset: VoxelPreset,
        point_range: PointRange | None = None,
        selection: Selection | None = None,
    ) -> None:
        backbone = preset.backbone
        edge, _, height = preset.voxel
        cell = edge * STRIDE * backbone.total_stride
        fitted = fitted_range(
            preset.point_range, preset.sensor_height, point_range, (cell, cell, height)
        )
        super().__init__(classes, fitted, preset.sensor_height, selection or Selection())
        self.grid = VoxelGrid(fitted, preset.voxel, preset.max_points, preset.max_voxels)
        nz, ny, nx = self.grid.shape
        layers = encoded_height(nz)
        if layers < 1:
            least = next(cells for cells in count(1) if encoded_height(cells + 1) >= 1)
            raise ValueError(
                f"this network needs a range at least {least * height:g} m high, found "
                f"{fitted[5] - fitted[2]:g} m"
            )
        anchors = [preset.anchors[name] for name in self.classes]
        stride = preset.image_stride
        places = anchor_grid(anchors, fitted, (nx // stride, ny // stride), preset.centred_anchors)
        self.backbone_3d = VoxelBackBone8x(4, preset.channels, backbone.momentum)
        self.backbone_2d = Backbone2d(preset.channels[-1] * layers, backbone)
        self.dense_head = AnchorHead(backbone.outputs, anchors, places)
        self.backbone_2d.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def first_stage(self, points: Sequence[Tensor]) -> FirstStage:
        """Features at all scales and raw outputs of the head for frames of points (N, 4)."""
        voxels = voxelise(points, self.grid, self.training, self.device)
        weight = self.dense_head.conv_cls.weight
        scales = self.backbone_3d(voxels.with_features(voxels.features.to(weight.dtype)))
        bev = scales["encoded"].bev()
        image = self.backbone_2d(bev)
        return FirstStage(scales, bev, image, self.dense_head(image))

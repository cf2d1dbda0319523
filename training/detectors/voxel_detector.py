"""Base of the detectors that start from voxels: SECOND and its two-stage descendants."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

import torch
from torch import Tensor

from lidarplace.base.errors import InputError
from training.detectors.backbones.backbone_2d import Backbone2d
from training.detectors.backbones.sparse_backbone import STRIDE, VoxelBackBone8x, encoded_height
from training.detectors.backbones.voxels import VoxelGrid, voxelise
from training.detectors.detector import Detector, PointRange, Selection, fitted_range
from training.detectors.heads.anchor_head import AnchorHead, HeadOutput
from training.detectors.heads.anchors import AnchorPreset, anchor_grid
from training.ops.sparse_conv import SparseTensor


@dataclass(frozen=True)
class VoxelPreset(AnchorPreset):
    """Everything that fixes the first stage of a voxel network but its classes."""

    voxel: tuple[float, float, float]  # edges of a voxel along x, y, z, metres
    max_points: int | None  # as in VoxelGrid
    max_voxels: tuple[int, int] | None
    channels: tuple[int, int, int, int, int]  # of the sparse backbone's scales and of its result

    @property
    def image_stride(self) -> int:
        """Voxels along x or y per cell of the 2D backbone's image."""
        return STRIDE * self.backbone.strides[0] // self.backbone.up_strides[0]


@dataclass(frozen=True)
class FirstStage:
    """Results of the first stage, B frames."""

    scales: dict[str, SparseTensor]  # "x_conv1" … "x_conv4" and "encoded" of the sparse backbone
    bev: Tensor  # the encoded grid from above, (B, C, ny, nx)
    image: Tensor  # result of the 2D backbone, (B, C2, ny, nx)
    head: HeadOutput  # raw outputs for all anchors


class VoxelDetector(Detector):
    """Voxels, a sparse 3D backbone, a 2D backbone and an anchor head.

    Raises ValueError if the range is too low for the backbone's strides."""

    def __init__(
        self,
        classes: Sequence[str],
        preset: VoxelPreset,
        point_range: PointRange | None = None,
        selection: Selection = Selection(),
    ) -> None:
        backbone, sensor_height = preset.backbone, preset.sensor_height
        edge, _, height = preset.voxel
        cell = edge * STRIDE * backbone.total_stride
        cells = (cell, cell, height)
        fitted = fitted_range(preset.point_range, sensor_height, point_range, cells)
        super().__init__(classes, fitted, sensor_height, selection)
        self.grid = VoxelGrid(fitted, preset.voxel, preset.max_points, preset.max_voxels)
        nz, ny, nx = self.grid.shape
        layers = encoded_height(nz)
        if layers < 1:
            least = next(cells for cells in count(1) if encoded_height(cells + 1) >= 1) * height
            wanted, height_found = f"at least {least:g} m high", f"{fitted[5] - fitted[2]:g} m"
            raise InputError(key="point_range", expected=wanted, found=height_found)
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

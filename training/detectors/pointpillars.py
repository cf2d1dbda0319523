"""PointPillars (Lang et al., CVPR 2019)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from training.detectors.backbones.backbone_2d import Backbone2d, BackboneSettings
from training.detectors.backbones.pillar_image import pillar_image
from training.detectors.backbones.pillars import PillarEncoder, PillarGrid, group, scatter
from training.detectors.detector import PointRange, builder, fitted_range
from training.detectors.heads.anchor_head import AnchorHead, HeadOutput
from training.detectors.heads.anchors import KITTI_ANCHORS, TINY_ANCHORS, AnchorPreset, anchor_grid
from training.detectors.one_stage_detector import OneStageDetector


@dataclass(frozen=True)
class PointPillarsPreset(AnchorPreset):
    """Everything that fixes a PointPillars network but its classes."""

    pillar: float  # edge of a pillar, metres
    max_points: int | None  # as in PillarGrid
    max_pillars: tuple[int, int] | None
    filters: int  # channels of a pillar


OPENPCDET = PointPillarsPreset(
    point_range=(0.0, -39.68, -3.0, 69.12, 39.68, 1.0),
    sensor_height=1.73,
    pillar=0.16,
    max_points=32,
    max_pillars=(16000, 40000),
    filters=64,
    backbone=BackboneSettings(
        layers=(3, 5, 5),
        strides=(2, 2, 2),
        filters=(64, 128, 256),
        up_strides=(1, 2, 4),
        up_filters=(128, 128, 128),
    ),
    anchors=KITTI_ANCHORS,
    centred_anchors=False,
)
"""OpenPCDet's tools/cfgs/kitti_models/pointpillar.yaml, in KITTI's LiDAR frame."""

PAPER = OPENPCDET  # the paper's fork leaves PointPillars as it is; only the range follows the ROI

TINY = PointPillarsPreset(
    point_range=(0.0, -20.0, 0.0, 40.0, 20.0, 4.0),
    sensor_height=0.0,
    pillar=0.4,
    max_points=None,
    max_pillars=None,
    filters=16,
    backbone=BackboneSettings(
        layers=(0, 2),
        strides=(2, 2),
        filters=(32, 64),
        up_strides=(1, 2),
        up_filters=(32, 32),
        momentum=0.1,
    ),
    anchors=TINY_ANCHORS,
    centred_anchors=True,
)

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


class PointPillars(OneStageDetector):
    """Pillars, their image from above, a 2D backbone and an anchor head."""

    def __init__(
        self,
        classes: Sequence[str],
        preset: PointPillarsPreset,
        point_range: PointRange | None = None,
    ) -> None:
        backbone, edge = preset.backbone, preset.pillar
        cell = edge * backbone.total_stride
        fitted = fitted_range(preset.point_range, preset.sensor_height, point_range, (cell, cell))
        super().__init__(classes, fitted, preset.sensor_height)
        self.grid = PillarGrid(fitted, (edge, edge), preset.max_points, preset.max_pillars)
        anchors = [preset.anchors[name] for name in self.classes]
        stride = backbone.strides[0] // backbone.up_strides[0]
        nx, ny = (cells // stride for cells in self.grid.shape)
        places = anchor_grid(anchors, fitted, (nx, ny), preset.centred_anchors)
        self.vfe = PillarEncoder(self.grid, preset.filters, backbone.momentum)
        self.backbone_2d = Backbone2d(preset.filters, backbone)
        self.dense_head = AnchorHead(backbone.outputs, anchors, places)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def head_output(self, points: Sequence[Tensor]) -> HeadOutput:
        """Raw outputs of the head for frames of points (N, 4)."""
        return self.dense_head(self.backbone_2d(self._pillars(points)))

    def _pillars(self, points: Sequence[Tensor]) -> Tensor:
        """The image of the pillars, (B, C, ny, nx)."""
        if self.device.type == "cpu":
            return pillar_image(points, self.vfe)
        batch = group(points, self.grid, self.training, self.device)
        batch = replace(batch, points=batch.points.to(self.dense_head.conv_cls.weight.dtype))
        return scatter(self.vfe(batch), batch.cells, len(points), self.grid)


build = builder(PointPillars, PRESETS)

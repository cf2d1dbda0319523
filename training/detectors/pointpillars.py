"""PointPillars (Lang et al., CVPR 2019)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from training.detectors.backbones.backbone_2d import Backbone2d, BackboneSettings
from training.detectors.backbones.pillar_image import pillar_image
from training.detectors.backbones.pillars import PillarEncoder, PillarGrid, group, scatter
from training.detectors.detector import PointRange, Selection, builder
from training.detectors.heads.anchor_head import AnchorHead, HeadOutput
from training.detectors.heads.anchors import KITTI_ANCHORS, TINY_ANCHORS, AnchorPreset, anchor_grid
from training.detectors.one_stage_detector import OneStageDetector
from training.detectors.point_range import fitted_range


@dataclass(frozen=True)
class PointPillarsPreset(AnchorPreset):
    """Everything that fixes a PointPillars network but its classes.

    Attributes:
        pillar: edge of a pillar, metres.
        max_points, max_pillars: as in PillarGrid.
        filters: channels of a pillar.
    """

    pillar: float
    max_points: int | None
    max_pillars: tuple[int, int] | None
    filters: int


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
        upsample_strides=(1, 2, 4),
        upsample_filters=(128, 128, 128),
    ),
    anchors=KITTI_ANCHORS,
    centred_anchors=False,
)
"""OpenPCDet's tools/cfgs/kitti_models/pointpillar.yaml, in KITTI's LiDAR frame."""

PAPER = OPENPCDET
"""The paper's fork leaves PointPillars as it is; only the range follows the ROI."""

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
        upsample_strides=(1, 2),
        upsample_filters=(32, 32),
        momentum=0.1,
    ),
    anchors=TINY_ANCHORS,
    centred_anchors=True,
)
"""Small enough to train on one CPU core; works in the ego frame."""

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


class PointPillars(OneStageDetector):
    """Pillars, their image from above, a 2D backbone and an anchor head.

    Args:
        classes: names of the classes, keys of the preset's anchors.
        preset: the network.
        point_range: see `fitted_range`.
    """

    def __init__(
        self,
        classes: Sequence[str],
        preset: PointPillarsPreset,
        point_range: PointRange | None = None,
    ) -> None:
        backbone = preset.backbone
        cell = preset.pillar * backbone.total_stride
        fitted = fitted_range(preset.point_range, preset.sensor_height, point_range, (cell, cell))
        grid = PillarGrid(
            fitted, (preset.pillar, preset.pillar), preset.max_points, preset.max_pillars
        )
        super().__init__(classes, grid.point_range, preset.sensor_height, Selection())
        self.grid = grid
        anchors = [preset.anchors[name] for name in self.classes]
        nx, ny = grid.shape
        stride = backbone.strides[0] // backbone.upsample_strides[0]
        places = anchor_grid(
            anchors, grid.point_range, (nx // stride, ny // stride), preset.centred_anchors
        )
        self.vfe = PillarEncoder(grid, preset.filters, preset.backbone.momentum)
        self.backbone_2d = Backbone2d(preset.filters, preset.backbone)
        self.dense_head = AnchorHead(preset.backbone.outputs, anchors, places)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def head_output(self, points: Sequence[Tensor]) -> HeadOutput:
        """Raw outputs of the head for frames of points (N, 4)."""
        output: HeadOutput = self.dense_head(self.backbone_2d(self._pillars(points)))
        return output

    def _pillars(self, points: Sequence[Tensor]) -> Tensor:
        """The image of the pillars, (B, C, ny, nx)."""
        if self.device.type == "cpu":
            return pillar_image(points, self.vfe)
        batch = group(points, self.grid, self.training, self.device)
        weight = self.dense_head.conv_cls.weight
        batch = replace(batch, points=batch.points.to(weight.dtype))
        return scatter(self.vfe(batch), batch.cells, len(points), self.grid)


build = builder(PointPillars, PRESETS)

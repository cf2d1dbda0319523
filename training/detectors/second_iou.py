"""SECOND-IoU: SECOND whose detections are ranked by a second stage, as OpenPCDet has it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from training.detectors import second
from training.detectors.detector import PointRange, builder
from training.detectors.heads.proposals import Suppression
from training.detectors.heads.roi_head import RoiOutput, RoiSettings
from training.detectors.heads.roi_targets import RoiSampling
from training.detectors.heads.second_iou_head import SecondIouHead, SecondIouLayers
from training.detectors.two_stage_voxel_detector import TwoStagePreset, TwoStageVoxelDetector
from training.detectors.voxel_detector import FirstStage


@dataclass(frozen=True)
class SecondIouPreset(TwoStagePreset):
    """Everything that fixes a SECOND-IoU network but its classes.

    Attributes:
        roi: proposals and training of the second stage.
        layers: of the second stage.
    """

    roi: RoiSettings
    layers: SecondIouLayers


OPENPCDET = SecondIouPreset(
    first_stage=second.OPENPCDET,
    roi=RoiSettings(
        train=Suppression(nms=0.8, pre=9000, post=512),
        test=Suppression(nms=0.7, pre=1024, post=100),
        sampling=RoiSampling(),
    ),
    layers=SecondIouLayers(),
)
"""OpenPCDet's tools/cfgs/kitti_models/second_iou.yaml, in KITTI's LiDAR frame."""

PAPER = replace(OPENPCDET, first_stage=second.PAPER)
"""The paper's changes to it."""

TINY = SecondIouPreset(
    first_stage=second.TINY,
    roi=RoiSettings(
        train=Suppression(nms=0.8, pre=512, post=128),
        test=Suppression(nms=0.7, pre=512, post=64),
        sampling=RoiSampling(rois=64),
    ),
    layers=SecondIouLayers(grid=5, shared=(64, 64), iou=(64, 64), dropout=0.0),
)
"""Small enough to train on one CPU core; works in the ego frame."""

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


class SecondIou(TwoStageVoxelDetector):
    """SECOND and a second stage that scores its boxes with their IoU.

    Arguments as of `VoxelDetector`.
    """

    def __init__(
        self, classes: Sequence[str], preset: SecondIouPreset, point_range: PointRange | None = None
    ) -> None:
        super().__init__(classes, preset.first_stage, point_range)
        first = preset.first_stage
        cell = first.voxel[0] * first.image_stride
        self.roi_head = SecondIouHead(
            first.backbone.outputs, self.point_range[:2], cell, preset.roi, preset.layers
        )

    def second_stage(self, rois: Tensor, seen: FirstStage) -> RoiOutput:
        """Scores of RoIs (B, R, 7)."""
        output: RoiOutput = self.roi_head(rois, seen.image)
        return output


build = builder(SecondIou, PRESETS)

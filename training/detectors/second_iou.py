"""SECOND-IoU: SECOND whose detections are ranked by a second stage, as OpenPCDet has it."""

from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from training.detectors import second
from training.detectors.detector import PointRange, builder
from training.detectors.heads.proposals import Suppression
from training.detectors.heads.roi_head import RoiOutput
from training.detectors.heads.roi_targets import RoiSampling
from training.detectors.heads.second_iou_head import SecondIouHead, SecondIouSettings
from training.detectors.two_stage_voxel_detector import TwoStagePreset, TwoStageVoxelDetector
from training.detectors.voxel_detector import FirstStage

OPENPCDET = TwoStagePreset(
    first_stage=second.OPENPCDET,
    roi_head=SecondIouSettings(
        train=Suppression(nms=0.8, pre=9000, post=512),
        test=Suppression(nms=0.7, pre=1024, post=100),
    ),
)
"""OpenPCDet's tools/cfgs/kitti_models/second_iou.yaml, in KITTI's LiDAR frame."""

PAPER = replace(OPENPCDET, first_stage=second.PAPER)

TINY = TwoStagePreset(
    first_stage=second.TINY,
    roi_head=SecondIouSettings(
        train=Suppression(nms=0.8, pre=512, post=128),
        test=Suppression(nms=0.7, pre=512, post=64),
        sampling=RoiSampling(rois=64),
        grid=5,
        shared=(64, 64),
        iou=(64, 64),
        dropout=0.0,
    ),
)

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


class SecondIou(TwoStageVoxelDetector):
    """SECOND and a second stage that scores its boxes with their IoU.

    Arguments as of `VoxelDetector`.
    """

    def __init__(
        self,
        classes: Sequence[str],
        preset: TwoStagePreset[SecondIouSettings],
        point_range: PointRange | None = None,
    ) -> None:
        first = preset.first_stage
        super().__init__(classes, first, point_range, preset.selection)
        cell = first.voxel[0] * first.image_stride
        inputs, corner = first.backbone.outputs, self.point_range[:2]
        self.roi_head = SecondIouHead(inputs, corner, cell, preset.roi_head)

    def second_stage(self, rois: Tensor, seen: FirstStage) -> RoiOutput:
        """Scores of RoIs (B, R, 7)."""
        output: RoiOutput = self.roi_head(rois, seen.image)
        return output


build = builder(SecondIou, PRESETS)

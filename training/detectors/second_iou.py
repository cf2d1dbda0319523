"""SECOND-IoU: SECOND whose detections are ranked by a second stage, as OpenPCDet has it."""

from dataclasses import replace

from torch import Tensor

from training.detectors import second
from training.detectors.detector import builder
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
    """SECOND and a second stage that scores its boxes with their IoU."""

    def make_second_stage(self, preset: TwoStagePreset[SecondIouSettings]) -> None:
        """The head, on the image of the 2D backbone."""
        first = preset.first_stage
        cell = first.voxel[0] * first.image_stride
        inputs, corner = first.backbone.outputs, self.point_range[:2]
        self.roi_head = SecondIouHead(inputs, corner, cell, preset.roi_head)

    def second_stage(self, rois: Tensor, seen: FirstStage) -> RoiOutput:
        """Scores of RoIs (B, R, 7)."""
        return self.roi_head(rois, seen.image)


build = builder(SecondIou, PRESETS)

"""SECOND (Yan et al., Sensors 2018)."""

from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from training.detectors.backbones.backbone_2d import BackboneSettings
from training.detectors.detector import builder
from training.detectors.heads.anchor_head import HeadOutput
from training.detectors.heads.anchors import KITTI_ANCHORS, PAPER_ANCHORS, TINY_ANCHORS
from training.detectors.one_stage_detector import OneStageDetector
from training.detectors.voxel_detector import VoxelDetector, VoxelPreset

OPENPCDET = VoxelPreset(
    point_range=(0.0, -40.0, -3.0, 70.4, 40.0, 1.0),
    sensor_height=1.73,
    voxel=(0.05, 0.05, 0.1),
    max_points=5,
    max_voxels=(16000, 40000),
    channels=(16, 32, 64, 64, 128),
    backbone=BackboneSettings(
        layers=(5, 5), strides=(1, 2), filters=(128, 256), up_strides=(1, 2), up_filters=(256, 256)
    ),
    anchors=KITTI_ANCHORS,
    centred_anchors=False,
)
"""OpenPCDet's tools/cfgs/kitti_models/second.yaml, in KITTI's LiDAR frame."""

PAPER = replace(OPENPCDET, point_range=(0.0, -20.0, -3.0, 40.0, 20.0, 1.0), anchors=PAPER_ANCHORS)

TINY = VoxelPreset(
    point_range=(0.0, -20.0, 0.0, 40.0, 20.0, 4.0),
    sensor_height=0.0,
    voxel=(0.2, 0.2, 0.16),
    max_points=None,
    max_voxels=None,
    channels=(8, 16, 16, 32, 32),
    backbone=BackboneSettings(
        layers=(2,), strides=(1,), filters=(64,), up_strides=(2,), up_filters=(64,), momentum=0.1
    ),
    anchors=TINY_ANCHORS,
    centred_anchors=True,
)

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


class Second(OneStageDetector, VoxelDetector):
    """The first stage alone: its anchors are the detections."""

    def head_output(self, points: Sequence[Tensor]) -> HeadOutput:
        """Raw outputs of the head for frames of points (N, 4)."""
        return self.first_stage(points).head


build = builder(Second, PRESETS)

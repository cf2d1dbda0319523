"""Voxel R-CNN (Deng et al., AAAI 2021)."""

from dataclasses import replace

from torch import Tensor

from training.detectors import second
from training.detectors.backbones.backbone_2d import BackboneSettings
from training.detectors.detector import Selection, builder
from training.detectors.heads.proposals import Suppression
from training.detectors.heads.roi_head import RoiOutput
from training.detectors.heads.roi_targets import RoiSampling
from training.detectors.heads.voxel_rcnn_head import VoxelRcnnHead, VoxelRcnnSettings
from training.detectors.two_stage_voxel_detector import TwoStagePreset, TwoStageVoxelDetector
from training.detectors.voxel_detector import FirstStage

OPENPCDET = TwoStagePreset(
    first_stage=replace(
        second.OPENPCDET,
        backbone=BackboneSettings(
            layers=(5, 5),
            strides=(1, 2),
            filters=(64, 128),
            up_strides=(1, 2),
            up_filters=(128, 128),
        ),
    ),
    roi_head=VoxelRcnnSettings(
        train=Suppression(nms=0.8, pre=9000, post=512),
        test=Suppression(nms=0.7, pre=2048, post=100),
    ),
    selection=Selection(score=0.3, nms=0.1),
)
"""OpenPCDet's tools/cfgs/kitti_models/voxel_rcnn_car.yaml, in KITTI's LiDAR frame.

It knows cars only; other classes have SECOND's anchors.
"""

PAPER = replace(
    OPENPCDET, first_stage=replace(second.PAPER, backbone=OPENPCDET.first_stage.backbone)
)

TINY = TwoStagePreset(
    first_stage=second.TINY,
    roi_head=VoxelRcnnSettings(
        train=Suppression(nms=0.8, pre=512, post=128),
        test=Suppression(nms=0.7, pre=512, post=64),
        sampling=RoiSampling(rois=64),
        grid=4,
        radii=(0.8, 1.6, 3.2),
        reach=(4, 4, 4),
        samples=8,
        pooled=(16, 16),
        shared=(64, 64),
        cls=(64,),
        reg=(64,),
        dropout=0.0,
    ),
    selection=Selection(score=0.3, nms=0.1),
)

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


class VoxelRcnn(TwoStageVoxelDetector):
    """SECOND's first stage and a second one that looks at the voxels around its boxes."""

    def make_second_stage(self, preset: TwoStagePreset[VoxelRcnnSettings]) -> None:
        """The head, on the sparse backbone's last three scales."""
        channels = preset.first_stage.channels[1:4]
        self.roi_head = VoxelRcnnHead(channels, self.grid, preset.roi_head)

    def second_stage(self, rois: Tensor, seen: FirstStage) -> RoiOutput:
        """Scores and residuals of RoIs (B, R, 7)."""
        return self.roi_head(rois, seen.scales)


build = builder(VoxelRcnn, PRESETS)

"""PV-RCNN (Shi et al., CVPR 2020)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from training.detectors import second
from training.detectors.backbones.point_sampling import within
from training.detectors.backbones.set_abstraction import BallSettings
from training.detectors.backbones.sparse_backbone import encoded_height
from training.detectors.backbones.voxel_set_abstraction import (
    Keypoints,
    KeypointSettings,
    VoxelSetAbstraction,
    mixed,
)
from training.detectors.detector import Rows, Selection, builder
from training.detectors.heads.point_head import PointHeadSimple, point_targets, segmentation_loss
from training.detectors.heads.proposals import Suppression
from training.detectors.heads.pv_rcnn_head import PvRcnnHead, PvRcnnHeadSettings
from training.detectors.heads.roi_head import RoiOutput
from training.detectors.heads.roi_targets import RoiSampling
from training.detectors.two_stage_voxel_detector import TwoStagePreset, TwoStageVoxelDetector
from training.detectors.voxel_detector import FirstStage


@dataclass(frozen=True, kw_only=True)
class PvRcnnPreset(TwoStagePreset[PvRcnnHeadSettings]):
    """Everything that fixes a PV-RCNN network but its classes."""

    keypoints: KeypointSettings  # the points that stand for the scene
    point_head: tuple[int, ...]  # hidden layers that separate keypoints on objects from others


OPENPCDET = PvRcnnPreset(
    first_stage=second.OPENPCDET,
    keypoints=KeypointSettings(
        keypoints=2048,
        raw_points=BallSettings((0.4, 0.8), (16, 16), ((16, 16), (16, 16))),
        scales=(
            BallSettings((0.4, 0.8), (16, 16), ((16, 16), (16, 16))),
            BallSettings((0.8, 1.2), (16, 32), ((32, 32), (32, 32))),
            BallSettings((1.2, 2.4), (16, 32), ((64, 64), (64, 64))),
            BallSettings((2.4, 4.8), (16, 32), ((64, 64), (64, 64))),
        ),
        outputs=128,
    ),
    point_head=(256, 256),
    roi_head=PvRcnnHeadSettings(
        train=Suppression(nms=0.8, pre=9000, post=512),
        test=Suppression(nms=0.7, pre=1024, post=100),
        grid=6,
        balls=BallSettings((0.8, 1.6), (16, 16), ((64, 64), (64, 64))),
        shared=(256, 256),
        branch=(256, 256),
        dropout=0.3,
    ),
    selection=Selection(nms=0.1),
)
"""OpenPCDet's tools/cfgs/kitti_models/pv_rcnn.yaml, in KITTI's LiDAR frame."""

PAPER = replace(OPENPCDET, first_stage=second.PAPER)

TINY = PvRcnnPreset(
    first_stage=second.TINY,
    keypoints=KeypointSettings(
        keypoints=256,
        raw_points=BallSettings((0.8,), (8,), ((16,),)),
        scales=(
            BallSettings((0.8,), (8,), ((16,),)),
            BallSettings((1.2,), (8,), ((16,),)),
            BallSettings((2.4,), (8,), ((16,),)),
            BallSettings((4.8,), (8,), ((16,),)),
        ),
        outputs=32,
    ),
    point_head=(32,),
    roi_head=PvRcnnHeadSettings(
        train=Suppression(nms=0.8, pre=512, post=64),
        test=Suppression(nms=0.7, pre=512, post=50),
        sampling=RoiSampling(rois=32),
        grid=4,
        balls=BallSettings((1.0,), (8,), ((32,),)),
        shared=(64,),
        branch=(64,),
        dropout=0.0,
    ),
    selection=Selection(nms=0.1),
)

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


ScoredKeypoints = tuple[Keypoints, Tensor]
"""Keypoints and the logits (K, 1) of their lying on an object."""


class PvRcnn(TwoStageVoxelDetector):
    """SECOND's first stage; keypoints with features of all its scales; RoIs refined from them."""

    def make_second_stage(self, preset: PvRcnnPreset) -> None:
        """Keypoints, their head, and the head of the RoIs."""
        channels = preset.first_stage.channels
        bev = channels[-1] * encoded_height(self.grid.shape[0])
        self.pfe = VoxelSetAbstraction(preset.keypoints, self.grid, channels[:-1], bev)
        self.point_head = PointHeadSimple(self.pfe.inputs, preset.point_head)
        self.roi_head = PvRcnnHead(preset.keypoints.outputs, preset.roi_head)

    def between(self, points: Sequence[Tensor], first: FirstStage) -> ScoredKeypoints:
        """Keypoints of frames of points (N, 4), and whether they lie on objects."""
        inside, counts = within(points, self.point_range)
        inside = inside.to(self.device, non_blocking=True)
        scales = {name: mixed(voxels) for name, voxels in first.scales.items()}
        keypoints = self.pfe(inside, counts, scales, first.bev)
        return keypoints, self.point_head(keypoints.sources)

    def between_loss(self, seen: ScoredKeypoints, boxes: Rows, labels: Rows) -> dict[str, Tensor]:
        """Compute "point_cls" of the keypoints."""
        keypoints, logits = seen
        targets = point_targets(keypoints.xyz, keypoints.counts, boxes, labels)
        return {"point_cls": segmentation_loss(logits, targets.labels)}

    def second_stage(self, rois: Tensor, seen: ScoredKeypoints) -> RoiOutput:
        """Scores and residuals of RoIs (B, R, 7)."""
        keypoints, logits = seen
        return self.roi_head(keypoints, logits.sigmoid(), rois)


build = builder(PvRcnn, PRESETS)

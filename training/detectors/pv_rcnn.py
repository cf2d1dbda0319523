"""PV-RCNN (Shi et al., CVPR 2020)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from training.detectors import second
from training.detectors.backbones.point_sampling import within
from training.detectors.backbones.sparse_backbone import STRIDE, encoded_height
from training.detectors.backbones.voxel_set_abstraction import (
    BallSettings,
    Keypoints,
    KeypointSettings,
    VoxelSetAbstraction,
)
from training.detectors.detector import PointRange, Selection
from training.detectors.heads.point_head import PointHeadSimple, point_targets
from training.detectors.heads.proposals import Suppression
from training.detectors.heads.pv_rcnn_head import PvRcnnHead, PvRcnnHeadSettings
from training.detectors.heads.roi_head import RoiSettings
from training.detectors.heads.roi_targets import RoiSampling
from training.detectors.voxel_detector import FirstStage, VoxelDetector, VoxelPreset


@dataclass(frozen=True)
class PvRcnnPreset:
    """Everything that fixes a PV-RCNN network but its classes.

    Attributes:
        first_stage: voxels, backbones and anchors.
        keypoints: the points that stand for the scene.
        point_head: outputs of the hidden layers that tell keypoints on objects from others.
        roi_head: the second stage.
        selection: of its boxes.
    """

    first_stage: VoxelPreset
    keypoints: KeypointSettings
    point_head: tuple[int, ...]
    roi_head: PvRcnnHeadSettings
    selection: Selection


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
        rois=RoiSettings(
            train=Suppression(nms=0.8, pre=9000, post=512),
            test=Suppression(nms=0.7, pre=1024, post=100),
            sampling=RoiSampling(),
        ),
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
"""The paper's changes to it."""

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
        rois=RoiSettings(
            train=Suppression(nms=0.8, pre=512, post=64),
            test=Suppression(nms=0.7, pre=512, post=50),
            sampling=RoiSampling(rois=32),
        ),
        grid=4,
        balls=BallSettings((1.0,), (8,), ((32,),)),
        shared=(64,),
        branch=(64,),
        dropout=0.0,
    ),
    selection=Selection(nms=0.1),
)
"""Small enough to train on one CPU core; works in the ego frame."""

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


class PvRcnn(VoxelDetector):
    """SECOND's first stage; keypoints with features of all its scales; RoIs refined from them.

    Args:
        classes: names of the classes, keys of the preset's anchors.
        preset: the network.
        point_range: see VoxelDetector.
    """

    def __init__(
        self,
        classes: Sequence[str],
        preset: PvRcnnPreset,
        point_range: PointRange | None = None,
    ) -> None:
        super().__init__(classes, preset.first_stage, preset.selection, point_range)
        channels = preset.first_stage.channels
        bev = channels[-1] * encoded_height(self.grid.shape[0])
        self.pfe = VoxelSetAbstraction(preset.keypoints, self.grid, channels[:-1], bev, STRIDE)
        self.point_head = PointHeadSimple(self.pfe.inputs, preset.point_head)
        self.roi_head = PvRcnnHead(preset.keypoints.outputs, preset.roi_head)

    def loss(
        self, points: Sequence[Tensor], boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> dict[str, Tensor]:
        """ "loss" and its parts.

        Of the first stage classification, location and direction, of the keypoints point_cls, of
        the second stage rcnn_cls, rcnn_reg and rcnn_corner.
        """
        boxes = [item.to(self.device) for item in boxes]
        labels = [item.to(self.device) for item in labels]
        first = self.first_stage(points)
        losses = self.dense_head.loss(first.head, self.dense_head.targets(boxes, labels))
        keypoints = self.keypoints(points, first)
        logits = self.point_head(keypoints.sources)
        targets = point_targets(keypoints.xyz, keypoints.counts, boxes, labels)
        second = self.point_head.loss(logits, targets)
        proposals = self.roi_head.propose(*self.dense_head.decode(first.head))
        sample = self.roi_head.sample(proposals, boxes, labels)
        output = self.roi_head(keypoints, logits.sigmoid(), sample.rois.boxes)
        second |= self.roi_head.loss(output, sample)
        losses["loss"] = losses["loss"] + sum(second.values())
        return losses | second

    @torch.no_grad()
    def predict(
        self, points: Sequence[Tensor], selection: Selection | None = None
    ) -> list[dict[str, Tensor]]:
        """Detections of every frame and "refined", see Detector."""
        self.eval()
        first = self.first_stage(points)
        keypoints = self.keypoints(points, first)
        proposals = self.roi_head.propose(*self.dense_head.decode(first.head))
        foreground = self.point_head(keypoints.sources).sigmoid()
        output = self.roi_head(keypoints, foreground, proposals.boxes)
        return self.roi_head.detections(output, proposals, selection or self.selection)

    def keypoints(self, points: Sequence[Tensor], first: FirstStage) -> Keypoints:
        """Keypoints of frames of points (N, 4) and the results of their first stage."""
        inside = [within(frame.to(self.device), self.point_range) for frame in points]
        return self.pfe(inside, first.scales, first.bev)


def build(classes: Sequence[str], preset: str, point_range: PointRange | None) -> PvRcnn:
    """The network of `build_detector`."""
    return PvRcnn(classes, PRESETS[preset], point_range)

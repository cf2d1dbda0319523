"""What detectors share whose second stage looks only at what a voxel network's first stage made."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor

from training.detectors.detector import Selection
from training.detectors.heads.roi_head import RoiHead, RoiOutput
from training.detectors.voxel_detector import FirstStage, VoxelDetector


class TwoStageVoxelDetector(VoxelDetector):
    """A voxel network with a second stage, `roi_head`, that derived classes make and call."""

    roi_head: RoiHead

    @abstractmethod
    def second_stage(self, rois: Tensor, first: FirstStage) -> RoiOutput:
        """Outputs of the second stage for RoIs (B, R, 7)."""

    def loss(
        self, points: Sequence[Tensor], boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> dict[str, Tensor]:
        """Losses of both heads: "loss" and those of AnchorHead and RoiHead."""
        boxes = [item.to(self.device) for item in boxes]
        labels = [item.to(self.device) for item in labels]
        first = self.first_stage(points)
        losses = self.dense_head.loss(first.head, self.dense_head.targets(boxes, labels))
        proposals = self.roi_head.propose(*self.dense_head.decode(first.head))
        targets = self.roi_head.sample(proposals, boxes, labels)
        second = self.roi_head.loss(self.second_stage(targets.rois.boxes, first), targets)
        losses["loss"] = losses["loss"] + sum(second.values())
        return losses | second

    @torch.no_grad()
    def predict(
        self, points: Sequence[Tensor], selection: Selection | None = None
    ) -> list[dict[str, Tensor]]:
        """Detections of every frame, see Detector."""
        self.eval()
        first = self.first_stage(points)
        proposals = self.roi_head.propose(*self.dense_head.decode(first.head))
        output = self.second_stage(proposals.boxes, first)
        return self.roi_head.detections(output, proposals, selection or self.selection)

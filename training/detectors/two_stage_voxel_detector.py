"""What detectors share whose second stage starts from the proposals of a voxel network."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import torch
from torch import Tensor

from training.detectors.detector import Selection
from training.detectors.heads.roi_head import RoiHead, RoiOutput
from training.detectors.voxel_detector import FirstStage, VoxelDetector, VoxelPreset
from training.typical_objects import TypicalObject


@dataclass(frozen=True)
class TwoStagePreset:
    """Base of the presets: `first_stage` is the voxel network."""

    first_stage: VoxelPreset

    def with_typical(self, typical: Sequence[TypicalObject]) -> Self:
        """The preset with anchors like these objects for their classes."""
        return replace(self, first_stage=self.first_stage.with_typical(typical))


class TwoStageVoxelDetector(VoxelDetector):
    """A voxel network with a second stage, `roi_head`, that derived classes make and call."""

    roi_head: RoiHead

    def between(self, points: Sequence[Tensor], first: FirstStage) -> Any:
        """What the second stage looks at: the first stage, unless a network makes more of it."""
        return first

    def between_loss(
        self, seen: Any, boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> dict[str, Tensor]:
        """Losses of what `between` made."""
        return {}

    @abstractmethod
    def second_stage(self, rois: Tensor, seen: Any) -> RoiOutput:
        """Outputs of the second stage for RoIs (B, R, 7)."""

    def loss(
        self, points: Sequence[Tensor], boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> dict[str, Tensor]:
        """Losses of both heads: "loss" and those of AnchorHead, `between_loss` and RoiHead."""
        boxes, labels = self.objects(boxes, labels)
        first = self.first_stage(points)
        losses = self.dense_head.loss(first.head, self.dense_head.targets(boxes, labels))
        seen = self.between(points, first)
        second = self.between_loss(seen, boxes, labels)
        proposals = self.roi_head.propose(*self.dense_head.decode(first.head))
        targets = self.roi_head.sample(proposals, boxes, labels)
        second |= self.roi_head.loss(self.second_stage(targets.rois.boxes, seen), targets)
        losses["loss"] = losses["loss"] + sum(second.values())
        return losses | second

    @torch.no_grad()
    def predict(
        self, points: Sequence[Tensor], selection: Selection | None = None
    ) -> list[dict[str, Tensor]]:
        """Detections of every frame and "refined", see Detector."""
        self.eval()
        first = self.first_stage(points)
        seen = self.between(points, first)
        proposals = self.roi_head.propose(*self.dense_head.decode(first.head))
        output = self.second_stage(proposals.boxes, seen)
        return self.roi_head.detections(output, proposals, selection or self.selection)

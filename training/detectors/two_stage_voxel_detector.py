"""Base of the detectors whose second stage starts from the proposals of a voxel network."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Self, TypeVar

import torch
from torch import Tensor

from training.detectors.detector import PointRange, Rows, Selection
from training.detectors.heads.roi_head import RoiHead, RoiOutput, RoiSettings
from training.detectors.heads.roi_targets import sample_rois
from training.detectors.voxel_detector import FirstStage, VoxelDetector, VoxelPreset
from training.typical_objects import TypicalObject

Settings = TypeVar("Settings", bound=RoiSettings)


@dataclass(frozen=True, kw_only=True)
class TwoStagePreset(Generic[Settings]):
    """Everything that fixes a network of two stages but its classes."""

    first_stage: VoxelPreset  # the voxel network
    roi_head: Settings  # the second stage
    selection: Selection = field(default_factory=Selection)  # how its boxes are selected

    def with_typical(self, typical: Sequence[TypicalObject]) -> Self:
        """The preset with anchors like these objects for their classes."""
        return replace(self, first_stage=self.first_stage.with_typical(typical))


class TwoStageVoxelDetector(VoxelDetector):
    """A voxel network with a second stage, `roi_head`, that derived classes make and call."""

    roi_head: RoiHead

    def __init__(
        self,
        classes: Sequence[str],
        preset: TwoStagePreset[Any],
        point_range: PointRange | None = None,
    ) -> None:
        super().__init__(classes, preset.first_stage, point_range, preset.selection)
        self.make_second_stage(preset)

    @abstractmethod
    def make_second_stage(self, preset: Any) -> None:
        """Make `roi_head`, and what `between` needs."""

    def between(self, points: Sequence[Tensor], first: FirstStage) -> Any:
        """Prepare what the second stage pools: the first stage, unless overridden."""
        return first

    def between_loss(self, seen: Any, boxes: Rows, labels: Rows) -> dict[str, Tensor]:
        """Losses of what `between` made."""
        return {}

    @abstractmethod
    def second_stage(self, rois: Tensor, seen: Any) -> RoiOutput:
        """Outputs of the second stage for RoIs (B, R, 7)."""

    def loss(self, points: Rows, boxes: Rows, labels: Rows) -> dict[str, Tensor]:
        """Losses of both heads: "loss" and those of AnchorHead, `between_loss` and RoiHead."""
        boxes, labels = self.objects(boxes, labels)
        first = self.first_stage(points)
        losses = self.dense_head.loss(first.head, self.dense_head.targets(boxes, labels))
        seen = self.between(points, first)
        second = self.between_loss(seen, boxes, labels)
        proposals = self.roi_head.propose(*self.dense_head.decode(first.head))
        targets = sample_rois(proposals, boxes, labels, self.roi_head.settings.sampling)
        second |= self.roi_head.loss(self.second_stage(targets.rois.boxes, seen), targets)
        losses["loss"] = losses["loss"] + sum(second.values())
        return losses | second

    @torch.no_grad()
    def predict(self, points: Rows, selection: Selection | None = None) -> list[dict[str, Tensor]]:
        """Detections of every frame and "refined", see Detector."""
        self.eval()
        first = self.first_stage(points)
        seen = self.between(points, first)
        proposals = self.roi_head.propose(*self.dense_head.decode(first.head))
        output = self.second_stage(proposals.boxes, seen)
        return self.roi_head.detections(output, proposals, selection or self.selection)

"""Base of the detectors whose anchors are the detections."""

from abc import abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor

from training.detectors.detector import Detector, Rows, Selection
from training.detectors.heads.anchor_head import AnchorHead, HeadOutput
from training.detectors.heads.selection import logit, select_boxes


class OneStageDetector(Detector):
    """A network that ends in an anchor head, `dense_head`, which derived classes make."""

    dense_head: AnchorHead

    @abstractmethod
    def head_output(self, points: Sequence[Tensor]) -> HeadOutput:
        """Raw outputs of the head for frames of points (N, 4)."""

    def loss(self, points: Rows, boxes: Rows, labels: Rows) -> dict[str, Tensor]:
        """Losses of the head: "loss", "classification", "location", "direction"."""
        targets = self.dense_head.targets(*self.objects(boxes, labels))
        return self.dense_head.loss(self.head_output(points), targets)

    @torch.no_grad()
    def predict(self, points: Rows, selection: Selection | None = None) -> list[dict[str, Tensor]]:
        """Detections of every frame, see Detector."""
        self.eval()
        selection = selection or self.selection
        likely = self.dense_head.decode_likely(self.head_output(points), logit(selection.score))
        return select_boxes(*likely, selection)

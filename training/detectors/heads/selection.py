"""From the scored boxes of a frame to its detections."""

from __future__ import annotations

import torch
from torch import Tensor

from training.detectors.detector import Selection
from training.ops.nms import nms


def select_boxes(scores: Tensor, boxes: Tensor, selection: Selection) -> dict[str, Tensor]:
    """Detections of one frame after class-agnostic suppression, best score first.

    Boxes that are not finite are no detections.

    Args:
        scores: probability of every class, shape (A, C).
        boxes: shape (A, 7).

    Returns "boxes" (M, 7), "scores" (M,) and "labels" (M,), int64 from 1.
    """
    best, label = scores.max(dim=1)
    # A badly trained network makes boxes without end, which overlap nothing that could be measured.
    usable = (best >= selection.score) & boxes.isfinite().all(dim=1)
    above = torch.nonzero(usable).flatten()
    kept = nms(boxes[above], best[above], selection.nms, selection.pre, selection.post)
    rows = above[kept]
    return {"boxes": boxes[rows], "scores": best[rows], "labels": label[rows] + 1}

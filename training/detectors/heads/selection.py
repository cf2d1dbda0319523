"""Selection of the detections of frames from their scored boxes."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from training.detectors.detector import Selection
from training.ops.nms import nms, rows_of


def select_boxes(logits: Tensor, boxes: Tensor, selection: Selection) -> list[dict[str, Tensor]]:
    """Select the detections of frames from boxes (B, A, 7) with logits (B, A, C) of every class.

    After class-agnostic suppression, best score first."""
    best, label = logits.max(dim=2)
    rows, counts = select_rows(best, boxes, selection)
    return detections(boxes, best, label + 1, rows, counts.tolist())


def detections(
    boxes: Tensor, logits: Tensor, labels: Tensor, rows: Tensor, counts: Sequence[int]
) -> list[dict[str, Tensor]]:
    """Gather the first `counts` of rows (B, M) of each frame: "boxes", "scores" and "labels".

    Boxes (M, 7), scores (M,) and labels (M,), int64 from 1. A score is a sigmoid that is rounded
    from double precision, so that it rises with its logit."""
    boxes, logits, labels = (rows_of(part, rows) for part in (boxes, logits, labels))
    parts = {"boxes": boxes, "scores": logits.double().sigmoid().to(logits.dtype), "labels": labels}
    return [
        {name: part[frame, :count] for name, part in parts.items()}
        for frame, count in enumerate(counts)
    ]


def select_rows(logits: Tensor, boxes: Tensor, selection: Selection) -> tuple[Tensor, Tensor]:
    """Select rows (B, M) of the detections among boxes (B, A, 7) with `logits` (B, A), best first.

    And how many are of each frame, (B,), see `nms`. Boxes that are not finite are no detections.
    Logits decide, not probabilities: those are rounded otherwise on another machine, and large ones
    are all 1."""
    # A badly trained network makes boxes without end, which overlap nothing that could be measured.
    usable = (logits >= logit(selection.score)) & boxes.isfinite().all(dim=2)
    rules = selection.nms, selection.pre, selection.post
    return nms(boxes, logits.masked_fill(~usable, -torch.inf), *rules)


def logit(probability: float) -> float:
    """The logit of a probability; infinite at 0 and 1."""
    if probability <= 0:
        return -math.inf
    return math.log(probability / (1 - probability)) if probability < 1 else math.inf

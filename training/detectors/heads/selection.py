"""Selection of the detections of a frame from its scored boxes."""

import math

import torch
from torch import Tensor

from training.detectors.detector import Selection
from training.ops.nms import nms


def select_boxes(logits: Tensor, boxes: Tensor, selection: Selection) -> dict[str, Tensor]:
    """Select the detections of a frame from boxes (A, 7) with logits (A, C) of every class.

    After class-agnostic suppression, best score first."""
    best, label = logits.max(dim=1)
    return detections(boxes, best, label + 1, select_rows(best, boxes, selection))


def detections(boxes: Tensor, logits: Tensor, labels: Tensor, rows: Tensor) -> dict[str, Tensor]:
    """Gather rows (M,) as "boxes" (M, 7), "scores" (M,) and "labels" (M,), int64 from 1.

    A score is a sigmoid that is rounded from double precision, so that it rises with its logit."""
    scores = logits[rows].double().sigmoid().to(logits.dtype)
    return {"boxes": boxes[rows], "scores": scores, "labels": labels[rows]}


def select_rows(logits: Tensor, boxes: Tensor, selection: Selection) -> Tensor:
    """Select the rows (M,) of the detections among boxes (A, 7) with `logits` (A,), best first.

    Boxes that are not finite are no detections. Logits decide, not probabilities: those are rounded
    otherwise on another machine, and large ones are all 1."""
    # A badly trained network makes boxes without end, which overlap nothing that could be measured.
    is_usable = (logits >= logit(selection.score)) & boxes.isfinite().all(dim=1)
    usable = torch.nonzero(is_usable).flatten()
    rules = selection.nms, selection.pre, selection.post
    return usable[nms(boxes[usable], logits[usable], *rules)]


def logit(probability: float) -> float:
    """The logit of a probability; infinite at 0 and 1."""
    if probability <= 0:
        return -math.inf
    return math.log(probability / (1 - probability)) if probability < 1 else math.inf

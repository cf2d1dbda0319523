"""Proposals: the boxes of a first stage that a second stage looks at again."""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor

from training.ops.nms import nms


@dataclass(frozen=True)
class Suppression:
    """How a frame's proposals are chosen from its boxes.

    Attributes:
        nms: largest IoU from above of two proposals (NMS_THRESH).
        pre: only the so many best boxes take part (NMS_PRE_MAXSIZE).
        post: number of proposals (NMS_POST_MAXSIZE).
    """

    nms: float
    pre: int
    post: int


@dataclass(frozen=True)
class Proposals:
    """Proposals of B frames, R each; where a frame has fewer, boxes of zeros fill up.

    Attributes:
        boxes: (B, R, 7).
        scores: logit of the likeliest class, (B, R).
        labels: that class, from 1, (B, R), int64.
    """

    boxes: Tensor
    scores: Tensor
    labels: Tensor


@torch.no_grad()
def propose(
    logits: Iterable[Tensor], boxes: Iterable[Tensor], suppression: Suppression
) -> Proposals:
    """The best boxes of every frame after class-agnostic suppression, best first.

    A box that is not finite cannot be looked at again and is no proposal.

    Args:
        logits: per frame (A, C), or all of them (B, A, C).
        boxes: per frame (A, 7), or all of them (B, A, 7).
    """
    frames = [
        _propose_in_frame(frame, frame_boxes, suppression)
        for frame, frame_boxes in zip(logits, boxes, strict=True)
    ]
    return Proposals(
        torch.stack([item.boxes for item in frames]),
        torch.stack([item.scores for item in frames]),
        torch.stack([item.labels for item in frames]),
    )


def _propose_in_frame(logits: Tensor, boxes: Tensor, suppression: Suppression) -> Proposals:
    scores, labels = logits.max(dim=1)
    usable = torch.nonzero(boxes.isfinite().all(dim=1) & scores.isfinite()).flatten()
    kept = nms(boxes[usable], scores[usable], suppression.nms, suppression.pre, suppression.post)
    rows = usable[kept]
    # Labels of the filling are 1, as upstream.
    result = Proposals(
        boxes.new_zeros(suppression.post, 7),
        scores.new_zeros(suppression.post),
        labels.new_ones(suppression.post),
    )
    result.boxes[: len(rows)] = boxes[rows]
    result.scores[: len(rows)] = scores[rows]
    result.labels[: len(rows)] = labels[rows] + 1
    return result

"""Proposals: the boxes of a first stage that a second stage looks at again."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from training.ops.nms import nms


@dataclass(frozen=True)
class Suppression:
    """Rule by which a frame's proposals are chosen from its boxes."""

    nms: float  # largest IoU from above of two proposals (NMS_THRESH)
    pre: int  # only the so many best boxes take part (NMS_PRE_MAXSIZE)
    post: int  # number of proposals (NMS_POST_MAXSIZE)


class Proposals(NamedTuple):
    """Proposals of B frames, R each; where a frame has fewer, boxes of zeros fill up."""

    boxes: Tensor  # (B, R, 7)
    scores: Tensor  # logit of the likeliest class, (B, R)
    labels: Tensor  # that class, from 1, (B, R), int64


@torch.no_grad()
def propose(
    logits: Iterable[Tensor], boxes: Iterable[Tensor], suppression: Suppression
) -> Proposals:
    """Choose the best of `boxes` (A, 7) with `logits` (A, C) of every frame, best first.

    Suppression is class-agnostic. A box that is not finite cannot be looked at again and is no
    proposal."""
    frames = [_propose_in_frame(*frame, suppression) for frame in zip(logits, boxes, strict=True)]
    return Proposals(*map(torch.stack, zip(*frames, strict=True)))


def _propose_in_frame(logits: Tensor, boxes: Tensor, suppression: Suppression) -> Proposals:
    scores, labels = logits.max(dim=1)
    usable = torch.nonzero(boxes.isfinite().all(dim=1) & scores.isfinite()).flatten()
    rules = suppression.nms, suppression.pre, suppression.post
    rows = usable[nms(boxes[usable], scores[usable], *rules)]
    fill = 0, suppression.post - len(rows)
    return Proposals(
        functional.pad(boxes[rows], (0, 0, *fill)),
        functional.pad(scores[rows], fill),
        functional.pad(labels[rows], fill) + 1,  # labels of the filling are 1, as upstream
    )

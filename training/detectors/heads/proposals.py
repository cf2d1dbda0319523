"""Proposals: the boxes of a first stage that a second stage looks at again."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from training.ops.nms import nms, rows_of


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
def propose(logits: Tensor, boxes: Tensor, suppression: Suppression) -> Proposals:
    """Choose the best of `boxes` (B, A, 7) with `logits` (B, A, C) of every frame, best first.

    Suppression is class-agnostic. A box that is not finite cannot be looked at again and is no
    proposal."""
    scores, labels = logits.max(dim=2)
    usable = boxes.isfinite().all(dim=2) & scores.isfinite()
    rules = suppression.nms, suppression.pre, suppression.post
    rows, counts = nms(boxes, scores.masked_fill(~usable, -torch.inf), *rules)
    filling = torch.arange(rows.shape[1], device=rows.device) >= counts[:, None]
    fill = 0, suppression.post - rows.shape[1]
    return Proposals(
        functional.pad(rows_of(boxes, rows).masked_fill(filling[..., None], 0), (0, 0, *fill)),
        functional.pad(rows_of(scores, rows).masked_fill(filling, 0), fill),
        # Labels of the filling are 1, as upstream.
        functional.pad(rows_of(labels, rows).masked_fill(filling, 0), fill) + 1,
    )

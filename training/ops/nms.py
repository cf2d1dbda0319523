"""Non-maximum suppression of rotated boxes seen from above."""

import torch
from torch import Tensor

from training.ops.box_overlap import checked, near, pair_iou
from training.ops.rotated_iou import unsuppressed

_CHUNK = 1 << 24
"""Pairs that the torch path looks at at once."""


def nms(
    boxes: Tensor, scores: Tensor, threshold: float, pre: int = 4096, post: int = 500
) -> Tensor:
    """Rows of the boxes that survive, highest score first, shape (K,), int64.

    A box is dropped if its IoU from above with a kept box of higher score is greater than
    `threshold`. Equal scores keep their order.

    Args:
        boxes: (N, 7), metres and radians, any frame with z up.
        scores: (N,).
        threshold: largest IoU that two kept boxes may have, at least 0.
        pre: only the so many highest scores take part (OpenPCDet's NMS_PRE_MAXSIZE).
        post: at most so many are kept (NMS_POST_MAXSIZE).

    Raises:
        ValueError: a box that takes part has a negative size or is not finite.
    """
    order = scores.detach().argsort(descending=True, stable=True)[:pre]
    best = boxes.detach()[order]
    if not best.is_cpu:
        return order[_unsuppressed_torch(best, threshold)[:post]]
    return order[torch.from_numpy(unsuppressed(best.numpy(), threshold, post))]


def _unsuppressed_torch(boxes: Tensor, threshold: float) -> Tensor:
    """Rows left when each kept box removes the later ones that overlap it.

    All boxes are kept at first; then each is kept if no kept one before it overlaps it, again and
    again until nothing changes. That ends with the sequential result after as many rounds as the
    longest chain of boxes has links, few in practice (Zheng et al., Cluster NMS, 2020).
    """
    boxes = checked(boxes)
    count = len(boxes)
    overlaps = torch.zeros(count, count, dtype=torch.bool, device=boxes.device)
    size = boxes[:, 3] * boxes[:, 4]
    step = max(1, _CHUNK // max(1, count))
    for low in range(0, count, step):
        own = slice(low, low + step)
        # The smaller over the larger is at least the IoU; the slack is for rounding.
        alike = torch.minimum(size[own, None], size) >= (threshold - 1e-9) * torch.maximum(
            size[own, None], size
        )
        row, column = (near(boxes[own], boxes) & alike).triu(low + 1).nonzero(as_tuple=True)
        row = low + row
        overlaps[row, column] = pair_iou(boxes[row], boxes[column], three_d=False) > threshold
    kept = torch.ones(count, dtype=torch.bool, device=boxes.device)
    while True:
        left = ~(overlaps & kept[:, None]).any(dim=0)
        if torch.equal(left, kept):
            return kept.nonzero().flatten()
        kept = left

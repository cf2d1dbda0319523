"""Non-maximum suppression of rotated boxes seen from above."""

import torch
from torch import Tensor

from training.ops.box_overlap import checked, near, pair_iou
from training.ops.grouping import chunks
from training.ops.rotated_iou import unsuppressed


def nms(
    boxes: Tensor, scores: Tensor, threshold: float, pre: int = 4096, post: int = 500
) -> Tensor:
    """Rows of boxes (N, 7) with scores (N,) that survive, highest score first, (K,) int64.

    A box is dropped if its IoU from above with a kept box of higher score is greater than
    `threshold`. Equal scores keep their order. Only the `pre` highest scores take part, at most
    `post` boxes are kept (OpenPCDet's NMS_PRE_MAXSIZE and NMS_POST_MAXSIZE).

    Raises ValueError if a box that takes part has a negative size or is not finite.
    """
    order = scores.detach().argsort(descending=True, stable=True)[:pre]
    best = boxes.detach()[order]
    if not best.is_cpu:
        return order[_unsuppressed_torch(best, threshold)[:post]]
    return order[torch.from_numpy(unsuppressed(best.numpy(), threshold, post))]


def _unsuppressed_torch(boxes: Tensor, threshold: float) -> Tensor:
    """Rows left when each kept box removes the later ones that overlap it.

    All are kept at first; then each that no kept one before it overlaps, again and again until
    nothing changes: as many rounds as the longest chain of boxes has links, few in practice (Zheng
    et al., Cluster NMS, 2020).
    """
    boxes = checked(boxes)
    count = len(boxes)
    overlaps = torch.zeros(count, count, dtype=torch.bool, device=boxes.device)
    size = boxes[:, 3] * boxes[:, 4]
    for own in chunks(count, count):
        smaller, larger = torch.minimum(size[own, None], size), torch.maximum(size[own, None], size)
        # Their quotient is at least the IoU; the slack is for rounding.
        alike = smaller >= (threshold - 1e-9) * larger
        row, column = (near(boxes[own], boxes) & alike).triu(own.start + 1).nonzero(as_tuple=True)
        row = own.start + row
        overlaps[row, column] = pair_iou(boxes[row], boxes[column], three_d=False) > threshold
    kept = torch.ones(count, dtype=torch.bool, device=boxes.device)
    while True:
        left = ~(overlaps & kept[:, None]).any(dim=0)
        if torch.equal(left, kept):
            return kept.nonzero().flatten()
        kept = left

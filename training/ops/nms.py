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

    Raises ValueError if a box that takes part has a negative size or is not finite."""
    order = scores.detach().argsort(descending=True, stable=True)[:pre]
    best = boxes.detach()[order]
    if not best.is_cpu:
        return order[_unsuppressed_torch(best, threshold)[:post]]
    return order[torch.from_numpy(unsuppressed(best.numpy(), threshold, post))]


def _unsuppressed_torch(boxes: Tensor, threshold: float) -> Tensor:
    """Rows that survive when each survivor removes the later boxes that overlap it.

    All survive at first; then each that no survivor before it overlaps, again and again until
    nothing changes: as many rounds as the longest chain of boxes has links, few in practice (Zheng
    et al., Cluster NMS, 2020)."""
    boxes = checked(boxes)
    count = len(boxes)
    overlaps = torch.zeros(count, count, dtype=torch.bool, device=boxes.device)
    size = boxes[:, 3] * boxes[:, 4]
    for part in chunks(count, count):
        pair = size[part, None], size
        smaller, larger = torch.minimum(*pair), torch.maximum(*pair)
        # Their quotient is at least the IoU; the slack is for rounding.
        alike = smaller >= (threshold - 1e-9) * larger
        row, column = (near(boxes[part], boxes) & alike).triu(part.start + 1).nonzero(as_tuple=True)
        row = part.start + row
        overlaps[row, column] = pair_iou(boxes[row], boxes[column], three_d=False) > threshold
    survives = torch.ones(count, dtype=torch.bool, device=boxes.device)
    while True:
        left = ~(overlaps & survives[:, None]).any(dim=0)
        if torch.equal(left, survives):
            return survives.nonzero().flatten()
        survives = left

"""Non-maximum suppression of rotated boxes seen from above."""

import torch
from torch import Tensor

from training.ops import rotated_iou


def nms(
    boxes: Tensor, scores: Tensor, threshold: float, pre: int = 4096, post: int = 500
) -> tuple[Tensor, Tensor]:
    """Select the boxes (B, N, 7) with scores (B, N) of each frame that survive, best score first.

    A box is dropped if its IoU from above with a kept box of higher score is greater than
    `threshold`. Equal scores keep their order. Only the `pre` highest scores above -∞ take part, at
    most `post` boxes are kept (OpenPCDet's NMS_PRE_MAXSIZE and NMS_POST_MAXSIZE).

    Returns rows of a frame's boxes, (B, K), K at most `post`, and how many of them survive, (B,);
    behind those a row is any.

    Raises ValueError if a box that takes part has a negative size or is not finite; a GPU does not
    check its boxes."""
    scores = scores.detach()
    order = scores.argsort(dim=1, descending=True, stable=True)[:, :pre]
    sizes = (scores > -torch.inf).sum(dim=1).clamp_max(pre)
    best = rows_of(boxes.detach(), order)
    select = _unsuppressed_numba if boxes.is_cpu else _unsuppressed_triton
    rows, counts = select(best, sizes, threshold, min(post, order.shape[1]))
    return order.gather(1, rows), counts


def rows_of(values: Tensor, rows: Tensor) -> Tensor:
    """Rows (B, K) of `values` (B, N, …) of each frame, (B, K, …)."""
    return values[torch.arange(len(rows), device=rows.device)[:, None], rows]


def _unsuppressed_numba(
    boxes: Tensor, sizes: Tensor, threshold: float, limit: int
) -> tuple[Tensor, Tensor]:
    rows, counts = torch.zeros(len(boxes), limit, dtype=torch.int64), torch.zeros_like(sizes)
    for frame, size in enumerate(sizes.tolist()):
        survivors = rotated_iou.unsuppressed(boxes[frame, :size].numpy(), threshold, limit)
        counts[frame] = len(survivors)
        rows[frame, : len(survivors)] = torch.from_numpy(survivors)
    return rows, counts


def _unsuppressed_triton(
    boxes: Tensor, sizes: Tensor, threshold: float, limit: int
) -> tuple[Tensor, Tensor]:
    from training.ops.gpu.rotated_iou import unsuppressed

    return unsuppressed(boxes, sizes, threshold, limit)

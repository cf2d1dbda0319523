"""Overlap of rotated boxes as tensors, on any device, in float64; gradients do not flow."""

import torch
from torch import Tensor

from training.ops import rotated_iou


def iou_3d(a: Tensor, b: Tensor) -> Tensor:
    """IoU of the volumes of boxes (B, N, 7) and (B, M, 7) of B frames, (B, N, M), dtype of `a`.

    Raises ValueError for a negative size or a value not finite; a GPU does not check its boxes."""
    a, b = a.detach(), b.detach()
    if not a.is_cpu:
        from training.ops.gpu.rotated_iou import iou_3d as iou_of_frames

        return iou_of_frames(a, b)
    out = a.new_empty(len(a), a.shape[1], b.shape[1])
    for frame, *boxes in zip(out, a.numpy(), b.numpy(), strict=True):
        frame.copy_(torch.from_numpy(rotated_iou.iou_3d(*boxes)))
    return out

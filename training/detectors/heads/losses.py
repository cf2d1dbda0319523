"""Losses of the heads, and what points learn."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

BETA = 1 / 9  # where smooth L1 turns from a square into a line


@dataclass(frozen=True)
class Targets:
    """Targets of the points of a batch."""

    labels: Tensor  # label of the object, 0 for background, -1 for neither, shape (N,), int64
    positive: Tensor  # those with an object, shape (P,), int64
    boxes: Tensor  # their objects, shape (P, 7)


def sigmoid_focal_loss(logits: Tensor, targets: Tensor, alpha: float = 0.25) -> Tensor:
    """Focal loss, gamma = 2, of every element, same shape; targets are 0 or 1.

    Lin et al., Focal loss for dense object detection, ICCV 2017."""
    # 1 - p where the target is 1, p where it is 0.
    wrong = (torch.sigmoid(logits) - targets).abs()
    weight = ((1 - alpha) + (2 * alpha - 1) * targets) * wrong.square()
    return weight * functional.binary_cross_entropy_with_logits(logits, targets, reduction="none")


def sine_smooth_l1(predicted: Tensor, target: Tensor) -> Tensor:
    """Smooth L1 loss of residuals (…, 7), same shape, with sin(Δyaw) in place of Δyaw.

    SECOND (Sensors 2018), section 3.2.2: a box turned by 180° costs nothing."""
    difference = predicted - target
    # The form of upstream, sin a cos b - cos a sin b, loses digits that sin(a - b) keeps.
    difference = torch.cat([difference[..., :6], torch.sin(difference[..., 6:])], dim=-1)
    return functional.smooth_l1_loss(
        difference, torch.zeros_like(difference), reduction="none", beta=BETA
    )

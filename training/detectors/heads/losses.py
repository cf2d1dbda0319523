"""Losses of the heads."""

import torch
from torch import Tensor
from torch.nn import functional

BETA = 1 / 9  # where smooth L1 turns from a square into a line
_ALPHA = 0.25  # weight of targets of 1 in the focal loss, of others 1 - _ALPHA


def focal_loss(logits: Tensor, targets: Tensor, weight: Tensor) -> Tensor:
    """Sum of the focal losses, gamma = 2, of logits (…, C), times the weights (…,) of their rows.

    Targets (…, C) are bool. Lin et al., Focal loss for dense object detection, ICCV 2017."""
    wrong = torch.where(targets, -logits, logits)
    scale = torch.where(targets, _ALPHA, 1 - _ALPHA) * weight[..., None]
    return (scale * wrong.sigmoid().square() * functional.softplus(wrong)).sum()


def sine_smooth_l1(predicted: Tensor, target: Tensor) -> Tensor:
    """Smooth L1 loss of residuals (…, 7), same shape, with sin(Δyaw) in place of Δyaw.

    SECOND (Sensors 2018), section 3.2.2: a box turned by 180° costs nothing."""
    difference = predicted - target
    # The form of upstream, sin a cos b - cos a sin b, loses digits that sin(a - b) keeps.
    difference = torch.cat([difference[..., :6], torch.sin(difference[..., 6:])], dim=-1)
    return functional.smooth_l1_loss(
        difference, torch.zeros_like(difference), reduction="none", beta=BETA
    )

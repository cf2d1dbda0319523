"""Losses of the heads."""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn import functional

BETA = 1 / 9  # where smooth L1 turns from a square into a line
_ALPHA = 0.25  # weight of targets of 1 in the focal loss, of others 1 - _ALPHA


def focal_loss(logits: Tensor, targets: Tensor, weight: Tensor) -> Tensor:
    """Sum of the focal losses, gamma = 2, of logits (…, C), times the weights (…,) of their rows.

    Targets (…, C) are bool. Lin et al., Focal loss for dense object detection, ICCV 2017."""
    result: Tensor = _FocalLoss.apply(logits, targets, weight)
    return result


class _FocalLoss(torch.autograd.Function):
    """The loss is a p² softplus(z), where z is the logit or, for targets, its negative.

    p = sigmoid(z), and the derivative to z is a p² (2 (1 - p) softplus(z) + p)."""

    @staticmethod
    def forward(ctx: Any, logits: Tensor, targets: Tensor, weight: Tensor) -> Tensor:
        z = torch.where(targets, -logits, logits)
        p, softplus = z.sigmoid(), functional.softplus(z)
        factor = p.square().mul_(weight[..., None])
        factor = torch.where(targets, factor * _ALPHA, factor * (1 - _ALPHA))
        if ctx.needs_input_grad[0]:
            slope = torch.addcmul(p, 1 - p, softplus, value=2).mul_(factor)
            ctx.save_for_backward(torch.where(targets, -slope, slope))
        return factor.mul_(softplus).sum()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        return ctx.saved_tensors[0] * gradient, None, None


def sine_smooth_l1(predicted: Tensor, target: Tensor) -> Tensor:
    """Smooth L1 loss of residuals (…, 7), same shape, with sin(Δyaw) in place of Δyaw.

    SECOND (Sensors 2018), section 3.2.2: a box turned by 180° costs nothing."""
    difference = predicted - target
    # The form of upstream, sin a cos b - cos a sin b, loses digits that sin(a - b) keeps.
    difference = torch.cat([difference[..., :6], torch.sin(difference[..., 6:])], dim=-1)
    return functional.smooth_l1_loss(
        difference, torch.zeros_like(difference), reduction="none", beta=BETA
    )

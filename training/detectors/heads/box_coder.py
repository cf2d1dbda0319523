"""Boxes as residuals to anchors."""

import torch
from torch import Tensor

_SMALLEST = 1e-5  # sizes below this, metres, are raised to it: their logarithm must exist


def encode(boxes: Tensor, anchors: Tensor) -> Tensor:
    """Residuals (…, 7) of boxes (…, 7) to anchors (…, 7): SECOND (Sensors 2018), equation (1).

    Offsets in x and y over the anchor's diagonal, in z over its height, logarithms of the ratios of
    sizes, difference of yaw."""
    size, anchor_size = (item[..., 3:6].clamp_min(_SMALLEST) for item in (boxes, anchors))
    offset = (boxes[..., :3] - anchors[..., :3]) / _scale(anchor_size)
    yaw = boxes[..., 6:] - anchors[..., 6:]
    return torch.cat([offset, torch.log(size / anchor_size), yaw], dim=-1)


def decode(residuals: Tensor, anchors: Tensor) -> Tensor:
    """Boxes (…, 7) of residuals (…, 7) to anchors (…, 7)."""
    anchor_size = anchors[..., 3:6]
    place = residuals[..., :3] * _scale(anchor_size) + anchors[..., :3]
    size = residuals[..., 3:6].exp() * anchor_size
    return torch.cat([place, size, residuals[..., 6:] + anchors[..., 6:]], dim=-1)


def _scale(size: Tensor) -> Tensor:
    diagonal = torch.sqrt(size[..., :1].square() + size[..., 1:2].square())
    return torch.cat([diagonal, diagonal, size[..., 2:]], dim=-1)


def limit_period(angle: Tensor, offset: float, period: float) -> Tensor:
    """The angle moved by whole periods into [-offset, 1 - offset) × period, radians."""
    return angle - torch.floor(angle / period + offset) * period

"""Boxes in the frame of a RoI, and as residuals to it.

The frame of a RoI has its origin at the RoI's centre and its x axis along the RoI's length
(Shi et al., PointRCNN, CVPR 2019, section 3.3)."""

import math

import torch
from torch import Tensor

from training.detectors.heads.box_coder import decode, encode, limit_period
from training.ops.points_in_boxes import cos_sin


def encode_in_rois(boxes: Tensor, rois: Tensor) -> Tensor:
    """Residuals (…, 7) of boxes (…, 7) to RoIs (…, 7); the difference of yaw is in [-π/2, π/2).

    A box that points backwards in its RoI is turned round: which way is front is the first
    stage's choice."""
    offset = turned(boxes[..., None, :3] - rois[..., None, :3], -rois[..., 6]).squeeze(-2)
    yaw = limit_period(boxes[..., 6:] - rois[..., 6:], 0.5, math.pi)
    return encode(torch.cat([offset, boxes[..., 3:6], yaw], dim=-1), _at_origin(rois, 0.0))


def decode_in_rois(residuals: Tensor, rois: Tensor) -> Tensor:
    """Boxes (…, 7) of residuals (…, 7) to RoIs (…, 7)."""
    local = decode(residuals, _at_origin(rois, 1.0))
    centre = turned(local[..., None, :3], rois[..., 6]).squeeze(-2) + rois[..., :3]
    return torch.cat([centre, local[..., 3:]], dim=-1)


def turned(points: Tensor, angle: Tensor) -> Tensor:
    """Points (…, P, 3) turned about z by angles (…), radians, counterclockwise from above."""
    x, y, z = points.unbind(dim=-1)
    cos, sin = (part[..., None] for part in cos_sin(angle))
    return torch.stack([x * cos - y * sin, x * sin + y * cos, z], dim=-1)


def roi_grid(rois: Tensor, size: int) -> Tensor:
    """Centres of a grid of size³ equal cells in each RoI (R, 7), (R, size³, 3), z fastest."""
    steps = (torch.arange(size, device=rois.device, dtype=rois.dtype) + 0.5) / size
    unit = torch.cartesian_prod(steps, steps, steps)
    sizes = rois[:, None, 3:6]
    return turned(unit * sizes - sizes / 2, rois[:, 6]) + rois[:, None, :3]


def _at_origin(rois: Tensor, yaw: float) -> Tensor:
    """The RoIs at 0, 0, 0, their yaw times `yaw`."""
    return torch.cat([torch.zeros_like(rois[..., :3]), rois[..., 3:6], rois[..., 6:] * yaw], dim=-1)

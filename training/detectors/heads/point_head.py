"""Heads on points: which object a point lies on, and that object's box."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.detectors.detector import Rows
from training.detectors.heads.box_coder import decode, encode
from training.detectors.heads.losses import BETA, focal_loss
from training.detectors.layers import PaddedBatchNorm, precise
from training.ops.points_in_boxes import box_of_points

EXTRA = 0.2
"""Points this near outside an object, counting both sides, learn neither it nor background, m."""


class PointTargets(NamedTuple):
    """Targets of the points of a batch."""

    labels: Tensor  # label of the object, 0 for background, -1 for neither, shape (N,), int64
    boxes: Tensor  # box of the object, zeros without one, shape (N, 7)


def point_targets(xyz: Tensor, counts: Sequence[int], boxes: Rows, labels: Rows) -> PointTargets:
    """Find the object in which each of the points (N, 3), `counts` of each frame, lies.

    The objects of a frame are `boxes` (M, 7) and `labels` (M,), from 1."""
    row = box_of_points(xyz, counts, boxes)
    extra = boxes[0].new_zeros(7)
    extra[3:6] = EXTRA
    near = box_of_points(xyz, counts, [frame + extra for frame in boxes])
    # A point without an object has row -1, the last one.
    objects = torch.cat([*boxes, boxes[0].new_zeros(1, 7)])
    label = torch.cat([*labels, labels[0].new_zeros(1)])[row]
    return PointTargets(torch.where((near >= 0) & (row < 0), -1, label), objects[row])


def point_layers(inputs: int, hidden: Sequence[int], outputs: int) -> nn.Sequential:
    """Linear layers with batch norm and ReLU on rows (N, inputs), and a last one without."""
    layers: list[nn.Module] = []
    for before, after in pairwise([inputs, *hidden]):
        linear = nn.Linear(before, after, bias=False)
        layers += [linear, PaddedBatchNorm(after), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers, nn.Linear([inputs, *hidden][-1], outputs))


def segmentation_loss(logits: Tensor, labels: Tensor) -> Tensor:
    """Focal loss of logits (N, C) and labels (N,) of PointTargets, over the points on objects.

    With C = 1 all labels above 0 are the same."""
    classes = logits.shape[1]
    numbers = torch.arange(1, classes + 1, device=labels.device)
    weight = (labels >= 0).to(logits) / (labels > 0).sum().clamp_min(1)
    return focal_loss(logits, labels.clamp_max(classes)[:, None] == numbers, weight)


class PointHeadSimple(nn.Module):
    """Probability that a point lies on some object: PV-RCNN's keypoint segmentation."""

    def __init__(self, inputs: int, hidden: Sequence[int]) -> None:
        super().__init__()
        self.cls_layers = point_layers(inputs, hidden, 1)

    def forward(self, features: Tensor) -> Tensor:
        """Features (N, inputs) to logits (N, 1), at least float32."""
        return precise(self.cls_layers(features))


@dataclass(frozen=True)
class PointOutput:
    """Raw outputs for all points: logits (N, C), residuals (N, 8)."""

    logits: Tensor
    residuals: Tensor


class PointHeadBox(nn.Module):
    """Class and box of the object on which a point lies: the first stage of PointRCNN.

    Args:
        inputs: features of a point.
        hidden: outputs of the hidden layers of either branch.
        sizes: length, width, height of a typical object of each class, metres.
        either_way: a box may as well point backwards: of its two yaws the nearer one is learned."""

    sizes: Tensor

    def __init__(
        self, inputs: int, hidden: Sequence[int], sizes: Sequence[Sequence[float]], either_way: bool
    ) -> None:
        super().__init__()
        self.either_way = either_way
        self.register_buffer("sizes", torch.tensor(sizes), persistent=False)
        self.cls_layers = point_layers(inputs, hidden, len(sizes))
        self.box_layers = point_layers(inputs, hidden, 8)

    def forward(self, features: Tensor) -> PointOutput:
        """Outputs for points with features (N, inputs), at least float32."""
        return PointOutput(precise(self.cls_layers(features)), precise(self.box_layers(features)))

    def decode(self, output: PointOutput, xyz: Tensor) -> Tensor:
        """Boxes (N, 7) of points (N, 3), each with the size of its likeliest class."""
        sizes = self.sizes[output.logits.argmax(dim=1)]
        return decode_points(output.residuals, xyz, sizes)

    def loss(self, output: PointOutput, targets: PointTargets, xyz: Tensor) -> dict[str, Tensor]:
        """Compute "point_cls" and "point_box", both over the number of points on objects."""
        # All points, as a GPU's host would have to wait for the number of those on objects.
        positive = targets.labels > 0
        sizes = self.sizes[(targets.labels - 1).clamp_min(0)]
        expected = encode_points(targets.boxes, xyz, sizes).where(positive[:, None], 0)
        residuals = output.residuals.where(positive[:, None], 0)
        if self.either_way:
            backwards = (residuals * expected)[:, 6:].sum(dim=1, keepdim=True) < 0
            yaw = torch.where(backwards, -expected[:, 6:], expected[:, 6:])
            expected = torch.cat([expected[:, :6], yaw], dim=1)
        box = functional.smooth_l1_loss(residuals, expected, reduction="sum", beta=BETA)
        return {
            "point_cls": segmentation_loss(output.logits, targets.labels),
            "point_box": box / positive.sum().clamp_min(1),
        }


def encode_points(boxes: Tensor, xyz: Tensor, sizes: Tensor) -> Tensor:
    """Residuals (P, 8) of boxes (P, 7) to points (P, 3) with sizes (P, 3).

    Those of `box_coder.encode` to a box of that size around the point with yaw 0; cosine and sine
    stand for the yaw."""
    residuals, yaw = encode(boxes, _around(xyz, sizes)).split([6, 1], dim=1)
    return torch.cat([residuals, yaw.cos(), yaw.sin()], dim=1)


def decode_points(residuals: Tensor, xyz: Tensor, sizes: Tensor) -> Tensor:
    """Boxes (P, 7) of residuals (P, 8); the inverse of `encode_points`."""
    yaw = torch.atan2(residuals[:, 7:], residuals[:, 6:7])
    return decode(torch.cat([residuals[:, :6], yaw], dim=1), _around(xyz, sizes))


def _around(xyz: Tensor, sizes: Tensor) -> Tensor:
    return torch.cat([xyz, sizes, xyz.new_zeros(len(xyz), 1)], dim=1)

"""Anchors: the boxes that an anchor head refines, and which objects they are trained on."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from torch import Tensor

from training.detectors.backbones.backbone_2d import BackboneSettings
from training.detectors.detector import PointRange
from training.detectors.heads.box_coder import limit_period
from training.typical_objects import TypicalObject


@dataclass(frozen=True)
class AnchorClass:
    """The anchors of one class: one size, several rotations, one height.

    Attributes:
        size: length, width, height, metres.
        bottom: z of the anchor's bottom in the model's frame, metres.
        matched: an anchor with at least this IoU with an object learns that object.
        unmatched: an anchor with less than this IoU with every object learns background.
        rotations: yaw of the anchors, radians.
    """

    size: tuple[float, float, float]
    bottom: float
    matched: float
    unmatched: float
    rotations: tuple[float, ...] = (0.0, 1.57)


KITTI_ANCHORS = {
    "Car": AnchorClass((3.9, 1.6, 1.56), -1.78, matched=0.6, unmatched=0.45),
    "Pedestrian": AnchorClass((0.8, 0.6, 1.73), -0.6, matched=0.5, unmatched=0.35),
    "Cyclist": AnchorClass((1.76, 0.6, 1.73), -0.6, matched=0.5, unmatched=0.35),
}
"""OpenPCDet's for KITTI, in KITTI's LiDAR frame."""

PAPER_ANCHORS = KITTI_ANCHORS | {
    # Sizes are the paper's. It names no heights: these stand on the ground, as its objects do.
    "Pedestrian": replace(KITTI_ANCHORS["Pedestrian"], size=(0.7, 0.7, 1.5), bottom=-1.78),
    "Cyclist": replace(KITTI_ANCHORS["Cyclist"], size=(1.5, 0.9, 1.0), bottom=-1.78),
}
"""The paper's, in KITTI's LiDAR frame."""

TINY_ANCHORS = {
    "Car": AnchorClass((4.4, 1.9, 1.6), 0.0, matched=0.5, unmatched=0.35),
    "Pedestrian": AnchorClass((0.8, 0.6, 1.73), 0.0, matched=0.35, unmatched=0.2),
    "Cyclist": AnchorClass((1.76, 0.6, 1.73), 0.0, matched=0.35, unmatched=0.2),
}
"""For coarse cells, in the ego frame."""


@dataclass(frozen=True)
class AnchorPreset:
    """Base of the presets of networks with an anchor head.

    Attributes:
        point_range: default range in the model's frame, metres.
        sensor_height: height of the model's origin above the ground, metres.
        backbone: the 2D backbone.
        anchors: by class, in the model's frame.
        centred_anchors: as in `anchor_grid`.
    """

    point_range: PointRange
    sensor_height: float
    backbone: BackboneSettings
    anchors: Mapping[str, AnchorClass]
    centred_anchors: bool

    def with_typical(self, typical: Sequence[TypicalObject]) -> Self:
        """The preset with anchors like these objects for their classes."""
        return replace(self, anchors=with_typical(self.anchors, typical, self.sensor_height))


def with_typical(
    anchors: Mapping[str, AnchorClass], typical: Sequence[TypicalObject], sensor_height: float
) -> dict[str, AnchorClass]:
    """The anchors of a preset, and of `typical` objects, each in place of its class's.

    An anchor learns from the same overlaps as the one of the preset whose area is nearest.

    Args:
        sensor_height: height of the model's frame above the ground, metres.
    """

    def nearest(area: float) -> AnchorClass:
        return min(anchors.values(), key=lambda own: abs(math.log(_area(own.size) / area)))

    return {
        **anchors,
        **{
            item.name: replace(
                nearest(_area(item.size)), size=item.size, bottom=item.bottom - sensor_height
            )
            for item in typical
        },
    }


def _area(size: tuple[float, float, float]) -> float:
    """From above, square metres."""
    return size[0] * size[1]


@dataclass(frozen=True)
class AnchorTargets:
    """What each anchor of one frame has to learn.

    Attributes:
        labels: label of the object, 0 for background, -1 for neither, shape (A,), int64.
        positive: anchors with an object, shape (P,), int64.
        boxes: their objects, shape (P, 7).
    """

    labels: Tensor
    positive: Tensor
    boxes: Tensor


def anchor_grid(
    classes: Sequence[AnchorClass], point_range: PointRange, shape: tuple[int, int], centred: bool
) -> Tensor:
    """All anchors, shape (ny, nx, number of classes × rotations, 7), float32.

    Args:
        shape: nx, ny of the head's feature map.
        centred: anchors lie at the cells' centres; if not, they are spread from edge to edge of the
            range, as in OpenPCDet's KITTI models (align_center).
    """
    # Rounded step for step as in OpenPCDet, whose range is float32: which anchors tie for an object
    # depends on the last bit.
    corners = np.array(point_range, np.float32)
    axes = []
    for axis, cells in enumerate(shape):
        low, high = corners[axis], corners[axis + 3]
        step = float(high - low) / (cells if centred else cells - 1)
        start = float(low) + step / 2 if centred else float(low)
        axes.append(torch.arange(start, float(high) + 1e-5, step, dtype=torch.float32))
    y, x = torch.meshgrid(axes[1], axes[0], indexing="ij")
    anchors = []
    for item in classes:
        for rotation in item.rotations:
            rest = torch.tensor([item.bottom, *item.size, rotation])
            rest[0] += rest[3] / 2
            anchors.append(torch.cat([torch.stack([x, y], -1), rest.expand(*x.shape, 5)], -1))
    return torch.stack(anchors, dim=2)


def nearest_bev_iou(a: Tensor, b: Tensor) -> Tensor:
    """IoU from above of boxes (N, 7) and (M, 7) turned to the nearest multiple of 90°, (N, M)."""
    ax0, ay0, ax1, ay1 = (edge[:, None] for edge in _upright(a))
    bx0, by0, bx1, by1 = _upright(b)
    dx = (torch.minimum(ax1, bx1) - torch.maximum(ax0, bx0)).clamp_min(0)
    dy = (torch.minimum(ay1, by1) - torch.maximum(ay0, by0)).clamp_min(0)
    common = dx * dy
    areas = (ax1 - ax0) * (ay1 - ay0) + (bx1 - bx0) * (by1 - by0)
    return common / (areas - common).clamp_min(1e-6)


def _upright(boxes: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Lowest x and y, then highest, of the turned boxes, each (N,)."""
    x, y, _, length, width, _, yaw = boxes.unbind(dim=1)
    across = limit_period(yaw, 0.5, math.pi).abs() >= math.pi / 4
    half_x = torch.where(across, width, length) / 2
    half_y = torch.where(across, length, width) / 2
    return x - half_x, y - half_y, x + half_x, y + half_y


def assign_targets(
    anchors: Tensor, classes: Sequence[AnchorClass], boxes: Tensor, labels: Tensor
) -> AnchorTargets:
    """Give every anchor an object of its class, background, or neither.

    As OpenPCDet's AxisAlignedTargetAssigner: an anchor takes the object that it overlaps most if
    that is at least `matched`; each object's best anchors learn whatever the overlap.

    Args:
        anchors: (ny, nx, K, 7) of `anchor_grid`.
        boxes, labels: objects of the frame, (M, 7) and (M,), labels from 1 in order of `classes`.
    """
    per_class = [len(item.rotations) for item in classes]
    result = anchors.new_full(anchors.shape[:3], -1, dtype=torch.int64)
    chosen = anchors.new_zeros(anchors.shape[:3], dtype=torch.int64)
    first = 0
    for index, item in enumerate(classes):
        last = first + per_class[index]
        own = torch.nonzero(labels == index + 1).flatten()
        label, target = _assign_class(
            anchors[:, :, first:last].reshape(-1, 7), item, boxes[own], index + 1
        )
        result[:, :, first:last] = label.view(result[:, :, first:last].shape)
        if len(own):
            chosen[:, :, first:last] = own[target].view(result[:, :, first:last].shape)
        first = last
    flat = result.flatten()
    positive = torch.nonzero(flat > 0).flatten()
    return AnchorTargets(flat, positive, boxes[chosen.flatten()[positive]])


def _assign_class(
    anchors: Tensor, item: AnchorClass, boxes: Tensor, label: int
) -> tuple[Tensor, Tensor]:
    """Label of each anchor and the row of `boxes` that it overlaps most."""
    labels = torch.full((len(anchors),), -1, dtype=torch.int64, device=anchors.device)
    if len(boxes) == 0:
        return labels.zero_(), labels
    # Few objects, many anchors: anchors along the contiguous dimension are several times faster.
    overlap = nearest_bev_iou(boxes, anchors)
    best, target = overlap.max(dim=0)
    best_of_box = overlap.amax(dim=1, keepdim=True)
    # An object that no anchor touches has no best anchor.
    forced = ((overlap == best_of_box) & (best_of_box > 0)).any(dim=0)
    labels[best < item.unmatched] = 0
    labels[forced | (best >= item.matched)] = label
    return labels, target

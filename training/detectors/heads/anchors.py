"""Anchors: the boxes that an anchor head refines, and which objects they are trained on."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
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


def _upright(boxes: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Lowest x and y, then highest, of the turned boxes, each (N,)."""
    half_x, half_y = _halves(boxes)
    x, y = boxes[:, 0], boxes[:, 1]
    return x - half_x, y - half_y, x + half_x, y + half_y


def _halves(boxes: Tensor) -> tuple[Tensor, Tensor]:
    """Half of the sides along x and along y of the turned boxes, each (N,)."""
    length, width, yaw = boxes[:, 3], boxes[:, 4], boxes[:, 6]
    across = limit_period(yaw, 0.5, math.pi).abs() >= math.pi / 4
    return torch.where(across, width, length) / 2, torch.where(across, length, width) / 2


def assign_targets(
    anchors: Tensor, classes: Sequence[AnchorClass], boxes: Tensor, labels: Tensor
) -> AnchorTargets:
    """Give every anchor an object of its class, background, or neither.

    As OpenPCDet's AxisAlignedTargetAssigner: an anchor takes the object that it overlaps most if
    that is at least `matched`; each object's best anchors learn whatever the overlap. Overlap is
    the IoU from above of boxes turned to the nearest multiple of 90 degrees.

    Args:
        anchors: (ny, nx, K, 7) of `anchor_grid`, on a CPU.
        boxes, labels: objects of the frame, (M, 7) and (M,), labels from 1 in order of `classes`.

    Returns:
        Where `boxes` are.
    """
    grid, own = anchors.numpy(), labels.cpu().numpy()
    edges = torch.stack(_upright(boxes.to(anchors))).numpy()
    x, y = anchors[0, :, :, 0].numpy(), anchors[:, 0, :, 1].numpy()
    halves = torch.stack(_halves(anchors[0, 0])).numpy()
    result = np.full(grid.shape[:3], -1, np.int64)
    chosen = np.empty(grid.shape[:3], np.int64)
    first = 0
    for label, item in enumerate(classes, 1):
        part = slice(first, first + len(item.rotations))
        first = part.stop
        best, target, forced = _overlaps(
            x[:, part], y[:, part], halves[:, part], edges, np.flatnonzero(own == label)
        )
        view = result[:, :, part]
        view[best < item.unmatched] = 0
        view[forced | (best >= item.matched)] = label
        chosen[:, :, part] = target
    flat = result.ravel()
    positive = np.flatnonzero(flat > 0)
    found = boxes[torch.from_numpy(chosen.ravel()[positive]).to(boxes.device)]
    return AnchorTargets(
        torch.from_numpy(flat).to(boxes.device), torch.from_numpy(positive).to(boxes.device), found
    )


@njit(cache=True, error_model="numpy")
def _overlaps(x, y, halves, edges, objects):  # pragma: no cover - compiled
    """Largest overlap of each anchor, with which object, and whether it is that one's best.

    Args:
        x, y: of the anchors by column and by row of the grid, shapes (nx, R) and (ny, R).
        halves: of their sides along x and y, shape (2, R).
        edges: lowest x and y, then highest, of all objects, shape (4, M).
        objects: those that count.
    """
    shape = len(y), len(x), x.shape[1]
    best = np.zeros(shape, x.dtype)
    target = np.zeros(shape, np.int64)
    forced = np.zeros(shape, np.bool_)
    least = x.dtype.type(1e-6)
    for m in objects:
        x0, y0, x1, y1 = edges[:, m]
        area = (x1 - x0) * (y1 - y0)
        most = x.dtype.type(0)
        for again in range(2):
            for k in range(shape[2]):
                hx, hy = halves[:, k]
                for i in range(shape[0]):
                    low, high = y[i, k] - hy, y[i, k] + hy
                    dy = min(y1, high) - max(y0, low)
                    if not dy > 0:
                        continue
                    side = high - low
                    for j in range(shape[1]):
                        low, high = x[j, k] - hx, x[j, k] + hx
                        dx = min(x1, high) - max(x0, low)
                        if not dx > 0:
                            continue
                        common = dx * dy
                        overlap = common / max(area + (high - low) * side - common, least)
                        if again:
                            forced[i, j, k] |= overlap == most
                        else:
                            most = max(most, overlap)
                            if overlap > best[i, j, k]:
                                best[i, j, k], target[i, j, k] = overlap, m
    return best, target, forced

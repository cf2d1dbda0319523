"""Anchors: the boxes that an anchor head refines."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from torch import Tensor

from training.detectors.backbones.backbone_2d import BackboneSettings
from training.detectors.detector import PointRange
from training.typical_objects import TypicalObject


@dataclass(frozen=True)
class AnchorClass:
    """The anchors of one class: one size, several rotations, one height."""

    size: tuple[float, float, float]  # length, width, height, metres
    bottom: float  # z of the anchor's bottom in the model's frame, metres
    matched: float  # an anchor with at least this IoU with an object learns that object
    unmatched: float  # an anchor with less than this IoU with every object learns background
    rotations: tuple[float, ...] = (0.0, 1.57)  # yaw of the anchors, radians


KITTI_ANCHORS = {
    "Car": AnchorClass((3.9, 1.6, 1.56), -1.78, matched=0.6, unmatched=0.45),
    "Pedestrian": AnchorClass((0.8, 0.6, 1.73), -0.6, matched=0.5, unmatched=0.35),
    "Cyclist": AnchorClass((1.76, 0.6, 1.73), -0.6, matched=0.5, unmatched=0.35),
}
"""Anchors of OpenPCDet for KITTI, in KITTI's LiDAR frame."""

PAPER_ANCHORS = KITTI_ANCHORS | {
    # Sizes are the paper's. It names no heights: these stand on the ground, as its objects do.
    "Pedestrian": replace(KITTI_ANCHORS["Pedestrian"], size=(0.7, 0.7, 1.5), bottom=-1.78),
    "Cyclist": replace(KITTI_ANCHORS["Cyclist"], size=(1.5, 0.9, 1.0), bottom=-1.78),
}
"""Anchors of the paper, in KITTI's LiDAR frame."""

TINY_ANCHORS = {
    "Car": AnchorClass((4.4, 1.9, 1.6), 0.0, matched=0.5, unmatched=0.35),
    "Pedestrian": AnchorClass((0.8, 0.6, 1.73), 0.0, matched=0.35, unmatched=0.2),
    "Cyclist": AnchorClass((1.76, 0.6, 1.73), 0.0, matched=0.35, unmatched=0.2),
}
"""Anchors for coarse cells, in the ego frame."""


@dataclass(frozen=True)
class AnchorPreset:
    """Base of the presets of networks with an anchor head."""

    point_range: PointRange  # default range in the model's frame, metres
    sensor_height: float  # height of the model's origin above the ground, metres
    backbone: BackboneSettings  # the 2D backbone
    anchors: Mapping[str, AnchorClass]  # by class, in the model's frame
    centred_anchors: bool  # as in `anchor_grid`

    def with_typical(self, typical: Sequence[TypicalObject]) -> Self:
        """The preset with anchors like these objects for their classes.

        An anchor learns from the same overlaps as the one of the preset whose area is nearest."""

        def like(item: TypicalObject) -> AnchorClass:
            def difference(anchor: AnchorClass) -> float:
                return abs(math.log(math.prod(anchor.size[:2]) / math.prod(item.size[:2])))

            nearest = min(self.anchors.values(), key=difference)
            return replace(nearest, size=item.size, bottom=item.bottom - self.sensor_height)

        return replace(
            self, anchors={**self.anchors, **{item.name: like(item) for item in typical}}
        )


def anchor_grid(
    classes: Sequence[AnchorClass], point_range: PointRange, shape: tuple[int, int], centred: bool
) -> Tensor:
    """Lay out all anchors, shape (ny, nx, number of classes × rotations, 7), float32.

    `shape` is nx, ny of the head's feature map. Anchors that are not `centred` in its cells are
    spread from edge to edge of the range, as in OpenPCDet's KITTI models (align_center)."""
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

"""Interface of all detectors."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from lidarplace.base.errors import InputError
from training.typical_objects import TypicalObject

PointRange = tuple[float, float, float, float, float, float]
"""x, y, z of the lowest corner, then of the highest, metres."""

Rows = Sequence[Tensor]  # rows of every frame of a batch

Build = Callable[[Sequence[str], str, PointRange | None, Sequence[TypicalObject]], "Detector"]
"""Function that builds a network of some classes by the name of a preset, see `build_detector`."""


@dataclass(frozen=True)
class Selection:
    """Rule by which boxes of a frame are its detections."""

    score: float = 0.1  # lowest score kept
    nms: float = 0.01  # largest IoU from above of two detections
    pre: int = 4096  # only the so many best boxes take part in the suppression (NMS_PRE_MAXSIZE)
    post: int = 500  # at most so many are kept (NMS_POST_MAXSIZE)


def fitted_range(
    preset: PointRange, sensor_height: float, wanted: PointRange | None, cell: Sequence[float] = ()
) -> PointRange:
    """Range of a network in its frame: the preset's, or what is `wanted` in the ego frame, metres.

    A network whose frame is `sensor_height` above the ground, not 0, keeps its heights, to which
    its weights belong. Far ends move out to whole numbers of the coarsest cells, whose edges are
    `cell`, along x, y and, for voxels, z."""
    low, high = list(preset[:3]), list(preset[3:])
    if wanted is not None:
        axes = 3 if sensor_height == 0 else 2
        low[:axes], high[:axes] = wanted[:axes], wanted[3 : 3 + axes]
    for axis, edge in enumerate(cell):
        # A range that fits up to rounding must not gain a cell.
        high[axis] = low[axis] + math.ceil((high[axis] - low[axis]) / edge - 1e-6) * edge
    return low[0], low[1], low[2], high[0], high[1], high[2]


class Detector(nn.Module, ABC):
    """A network from a point cloud to 3D boxes.

    It works in its own frame: the ego frame moved up by `sensor_height`, so that the ground is at
    z = -sensor_height. Boxes are x, y, z of the centre, length, width, height, yaw; labels start
    at 1, as in OpenPCDet.

    Attributes:
        classes: names of the labels 1, 2, ….
        point_range: the model sees points and boxes in here, in its own frame.
        sensor_height: height of the frame's origin above the ground, metres.
        selection: the preset's way to select boxes.
        typical: objects of which anchors are, of those classes that have others than the preset's.
    """

    global_step: Tensor
    typical: tuple[TypicalObject, ...] = ()

    def __init__(
        self,
        classes: Sequence[str],
        point_range: PointRange,
        sensor_height: float = 0.0,
        selection: Selection = Selection(),
    ) -> None:
        super().__init__()
        self.classes = tuple(classes)
        self.point_range = point_range
        self.sensor_height = sensor_height
        self.selection = selection
        self.register_buffer("global_step", torch.zeros(1, dtype=torch.int64))

    @property
    def device(self) -> torch.device:
        """Device of the weights."""
        return self.global_step.device

    def objects(
        self, boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> tuple[list[Tensor], list[Tensor]]:
        """Move the objects of a batch to the device of the weights.

        Raises:
            ValueError: a label that is none of the network's. (A GPU would stop for good.)"""
        unknown = {label for item in labels for label in item.tolist()}
        unknown -= set(range(1, len(self.classes) + 1))
        if unknown:
            wanted = f"1 to {len(self.classes)}"
            raise InputError(key="labels", expected=wanted, found=sorted(unknown))
        counts = [len(item) for item in labels]
        moved_boxes, moved_labels = (
            torch.cat(list(part)).to(self.device, non_blocking=True).split(counts)
            for part in (boxes, labels)
        )
        return list(moved_boxes), list(moved_labels)

    @abstractmethod
    def loss(
        self, points: Sequence[Tensor], boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> dict[str, Tensor]:
        """Compute scalar losses of a batch of frames; "loss" is the one to minimise.

        Args:
            points: per frame (N, 4) float32: x, y, z, intensity.
            boxes: per frame (M, 7) float32.
            labels: per frame (M,) int64, from 1.

        Raises:
            ValueError: a label that is none of the network's."""

    @abstractmethod
    def predict(
        self, points: Sequence[Tensor], selection: Selection | None = None
    ) -> list[dict[str, Tensor]]:
        """Predict "boxes" (M, 7), "scores" (M,) and "labels" (M,) of each frame, best score first.

        Two-stage detectors add "refined" (R, 7): all boxes of the second stage, before any is
        dropped; OpenPCDet's `recall_rcnn` is computed from them. Switches to evaluation mode.

        Args:
            points: per frame (N, 4) float32: x, y, z, intensity; rows that are not finite or lie
                outside the range are not looked at.
            selection: in place of the preset's."""


def builder(network: Callable[..., Detector], presets: Mapping[str, Any]) -> Build:
    """Make the function `build` of a network's module: presets with anchors of typical objects."""
    return lambda classes, preset, point_range, typical: network(
        classes, presets[preset].with_typical(typical), point_range
    )

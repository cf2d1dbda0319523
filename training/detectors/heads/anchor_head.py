"""The dense head of SECOND and PointPillars: class, box and direction of every anchor."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.detectors.detector import Rows
from training.detectors.heads.anchors import AnchorClass, assign_targets
from training.detectors.heads.box_coder import decode, encode, limit_period
from training.detectors.heads.losses import Targets, sigmoid_focal_loss, sine_smooth_l1

# OpenPCDet's KITTI models.
BINS = 2
DIRECTION_OFFSET = 0.78539
LOCATION_WEIGHT = 2.0
DIRECTION_WEIGHT = 0.2
_PRIOR = 0.01
"""Score of an untrained anchor, so that background does not swamp the focal loss at first."""


@dataclass(frozen=True)
class HeadOutput:
    """Raw outputs for all anchors: logits (B, A, C), residuals (B, A, 7), bins (B, A, 2)."""

    logits: Tensor
    residuals: Tensor
    directions: Tensor


class AnchorHead(nn.Module):
    """Three 1 × 1 convolutions; `anchors` (ny, nx, K, 7) are those of `anchor_grid`."""

    anchors: Tensor
    __call__: Callable[..., HeadOutput]

    def __init__(self, inputs: int, classes: Sequence[AnchorClass], anchors: Tensor) -> None:
        super().__init__()
        self.classes = tuple(classes)
        self.register_buffer("anchors", anchors, persistent=False)
        self._grid = anchors  # stays on the CPU
        count = anchors.shape[2]
        self.conv_cls = nn.Conv2d(inputs, count * len(self.classes), 1)
        self.conv_box = nn.Conv2d(inputs, count * 7, 1)
        self.conv_dir_cls = nn.Conv2d(inputs, count * BINS, 1)
        nn.init.constant_(cast(Tensor, self.conv_cls.bias), -math.log((1 - _PRIOR) / _PRIOR))
        nn.init.normal_(self.conv_box.weight, std=0.001)

    def forward(self, image: Tensor) -> HeadOutput:
        """Feature map (B, inputs, ny, nx) to outputs of all anchors, in the order of `anchors`."""
        # One matrix product in place of three 1 × 1 convolutions: they are slow on a CPU.
        heads = (self.conv_cls, self.conv_box, self.conv_dir_cls)
        weight = torch.cat([head.weight.flatten(1) for head in heads])
        bias = torch.cat([cast(Tensor, head.bias) for head in heads])
        rows = functional.linear(image.permute(0, 2, 3, 1), weight, bias)
        # Under autocast the features are coarser than boxes and losses may be.
        rows = rows.to(self.anchors.dtype)
        logits, residuals, directions = rows.split([head.out_channels for head in heads], dim=-1)
        frames = len(image)
        return HeadOutput(
            logits.reshape(frames, -1, len(self.classes)),
            residuals.reshape(frames, -1, 7),
            directions.reshape(frames, -1, BINS),
        )

    def targets(self, boxes: Rows, labels: Rows) -> list[Targets]:
        """Compute what the anchors of each frame have to learn."""
        frames = zip(boxes, labels, strict=True)
        return [assign_targets(self._grid, self.classes, *objects) for objects in frames]

    def loss(self, output: HeadOutput, targets: Sequence[Targets]) -> dict[str, Tensor]:
        """Compute "loss" and its parts classification, location, direction, means over frames.

        Each frame's losses are divided by its number of anchors with an object, at least 1."""
        positives = torch.tensor([max(1, len(item.positive)) for item in targets])
        share = (1 / positives.to(output.logits)) / len(targets)
        label = torch.stack([item.labels for item in targets])
        one_hot = functional.one_hot(label.clamp_min(0), len(self.classes) + 1)[..., 1:]
        focal = sigmoid_focal_loss(output.logits, one_hot.to(output.logits))
        weight = (label >= 0) * share[:, None]
        classification = (focal * weight[..., None]).sum()
        rows = torch.cat([item.positive + i * label.shape[1] for i, item in enumerate(targets)])
        row_share = share[rows // label.shape[1]]
        anchors = self.anchors.reshape(-1, 7)[rows % label.shape[1]]
        boxes = torch.cat([item.boxes for item in targets])
        residuals = output.residuals.reshape(-1, 7)[rows]
        location = sine_smooth_l1(residuals, encode(boxes, anchors)).sum(dim=1)
        directions, expected = output.directions.reshape(-1, BINS)[rows], direction_bin(boxes[:, 6])
        bins = functional.cross_entropy(directions, expected, reduction="none")
        location = LOCATION_WEIGHT * (location * row_share).sum()
        direction = DIRECTION_WEIGHT * (bins * row_share).sum()
        parts = {"classification": classification, "location": location, "direction": direction}
        return {"loss": classification + location + direction, **parts}

    def decode(self, output: HeadOutput) -> tuple[Tensor, Tensor]:
        """Decode logits (B, A, C) and boxes (B, A, 7); yaw is turned into the predicted half."""
        anchors = self.anchors.reshape(1, -1, 7)
        return output.logits, _boxes(output.residuals, output.directions, anchors)

    def decode_likely(self, output: HeadOutput, lowest: float) -> list[tuple[Tensor, Tensor]]:
        """Decode per frame the anchors with some logit of at least `lowest`, in their order.

        Logits (P, C) and boxes (P, 7): few of the anchors are near an object."""
        frame, anchor = (output.logits.amax(dim=2) >= lowest).nonzero(as_tuple=True)
        anchors = self.anchors.reshape(-1, 7)[anchor]
        boxes = _boxes(output.residuals[frame, anchor], output.directions[frame, anchor], anchors)
        counts = frame.bincount(minlength=len(output.logits)).tolist()
        logits = output.logits[frame, anchor]
        return list(zip(logits.split(counts), boxes.split(counts), strict=True))


def _boxes(residuals: Tensor, directions: Tensor, anchors: Tensor) -> Tensor:
    """Boxes (…, 7) of residuals (…, 7) and direction bins (…, 2) of anchors (…, 7)."""
    boxes = decode(residuals, anchors)
    period = 2 * math.pi / BINS
    turn = limit_period(boxes[..., 6] - DIRECTION_OFFSET, 0.0, period)
    yaw = turn + DIRECTION_OFFSET + period * directions.argmax(dim=-1)
    return torch.cat([boxes[..., :6], yaw[..., None]], dim=-1)


def direction_bin(yaw: Tensor) -> Tensor:
    """Number of the half-circle from DIRECTION_OFFSET on that a yaw (P,) is in: 0 or 1, int64."""
    turn = limit_period(yaw - DIRECTION_OFFSET, 0.0, 2 * math.pi)
    return (turn / (2 * math.pi / BINS)).floor().long().clamp(0, BINS - 1)

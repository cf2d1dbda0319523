"""The dense head of SECOND and PointPillars: class, box and direction of every anchor."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.detectors.detector import Rows
from training.detectors.heads.anchor_targets import (
    ALL,
    AnchorTargets,
    Index,
    anchor_rules,
    assign_targets,
)
from training.detectors.heads.anchors import AnchorClass
from training.detectors.heads.box_coder import decode, encode, limit_period
from training.detectors.heads.losses import focal_loss, sine_smooth_l1

# OpenPCDet's KITTI models.
BINS = 2
DIRECTION_OFFSET = 0.78539
LOCATION_WEIGHT = 2.0
DIRECTION_WEIGHT = 0.2
_PRIOR = 0.01
"""Score of an untrained anchor, so that background does not swamp the focal loss at first."""


@dataclass(frozen=True)
class HeadOutput:
    """Logits of all anchors (B, A, C), and the features of their cells (B, ny * nx, inputs)."""

    logits: Tensor
    features: Tensor


class AnchorHead(nn.Module):
    """Three 1 × 1 convolutions; `anchors` (ny, nx, K, 7) are those of `anchor_grid`."""

    anchors: Tensor
    rules: Tensor
    __call__: Callable[..., HeadOutput]

    def __init__(self, inputs: int, classes: Sequence[AnchorClass], anchors: Tensor) -> None:
        super().__init__()
        self.classes = tuple(classes)
        self.register_buffer("anchors", anchors, persistent=False)
        self.register_buffer("rules", anchor_rules(classes), persistent=False)
        count = anchors.shape[2]
        self.conv_cls = nn.Conv2d(inputs, count * len(self.classes), 1)
        self.conv_box = nn.Conv2d(inputs, count * 7, 1)
        self.conv_dir_cls = nn.Conv2d(inputs, count * BINS, 1)
        nn.init.constant_(cast(Tensor, self.conv_cls.bias), -math.log((1 - _PRIOR) / _PRIOR))
        nn.init.normal_(self.conv_box.weight, std=0.001)

    def forward(self, image: Tensor) -> HeadOutput:
        """Score all anchors, in the order of `anchors`, by a feature map (B, inputs, ny, nx)."""
        features = image.permute(0, 2, 3, 1).flatten(1, 2)
        logits = self._linear(features, self.conv_cls)
        return HeadOutput(logits.reshape(len(image), -1, len(self.classes)), features)

    def raw_boxes(self, output: HeadOutput, index: Index = ALL) -> tuple[Tensor, Tensor]:
        """Residuals (…, 7) and direction bins (…, 2) of some anchors, or of all, (B, A, …)."""
        frame, anchor = index
        heads = self.conv_box, self.conv_dir_cls
        count = self.anchors.shape[2]
        if isinstance(anchor, slice):
            rows = self._linear(output.features, *heads)
            residuals, directions = rows.split([count * 7, count * BINS], dim=-1)
            frames = len(rows)
            return residuals.reshape(frames, -1, 7), directions.reshape(frames, -1, BINS)
        # Few anchors are near an object.
        rows = self._linear(output.features[frame, anchor // count], *heads)
        residuals, directions = rows.split([count * 7, count * BINS], dim=-1)
        row, kind = torch.arange(len(rows), device=rows.device), anchor % count
        parts = residuals.view(-1, count, 7), directions.view(-1, count, BINS)
        return parts[0][row, kind], parts[1][row, kind]

    def _linear(self, features: Tensor, *heads: nn.Conv2d) -> Tensor:
        """One matrix product in place of 1 × 1 convolutions, which are slow on a CPU."""
        weight = torch.cat([head.weight.flatten(1) for head in heads])
        bias = torch.cat([cast(Tensor, head.bias) for head in heads])
        # Under autocast the features are coarser than boxes and losses may be.
        return functional.linear(features, weight, bias).to(self.anchors.dtype)

    def targets(self, boxes: Rows, labels: Rows) -> AnchorTargets:
        """Compute what the anchors of each frame have to learn."""
        return assign_targets(self.anchors.float(), self.rules.float(), boxes, labels)

    def loss(self, output: HeadOutput, targets: AnchorTargets) -> dict[str, Tensor]:
        """Compute "loss" and its parts classification, location, direction, means over frames.

        Each frame's losses are divided by its number of anchors with an object, at least 1."""
        label, logits = targets.labels, output.logits
        positive = label > 0
        share = (1 / positive.sum(dim=1).clamp_min(1).to(logits))[:, None] / len(label)
        labels = torch.arange(1, len(self.classes) + 1, device=label.device)
        weight = (label >= 0) * share
        classification = focal_loss(logits, label[..., None] == labels, weight)
        anchors = self.anchors.reshape(-1, 7)[targets.index[1]]
        residuals, directions = self.raw_boxes(output, targets.index)
        location = sine_smooth_l1(residuals, encode(targets.boxes, anchors)).sum(dim=-1)
        expected = direction_bin(targets.boxes[..., 6])
        bins = functional.cross_entropy(
            directions.reshape(-1, BINS), expected.flatten(), reduction="none"
        ).view(expected.shape)
        weight = (positive * share)[targets.index]
        location = LOCATION_WEIGHT * (location * weight).sum()
        direction = DIRECTION_WEIGHT * (bins * weight).sum()
        parts = {"classification": classification, "location": location, "direction": direction}
        return {"loss": classification + location + direction, **parts}

    def decode(self, output: HeadOutput) -> tuple[Tensor, Tensor]:
        """Decode logits (B, A, C) and boxes (B, A, 7); yaw is turned into the predicted half."""
        return output.logits, _boxes(*self.raw_boxes(output), self.anchors.reshape(-1, 7))

    def decode_likely(self, output: HeadOutput, lowest: float) -> tuple[Tensor, Tensor]:
        """Decode the anchors with some logit of at least `lowest`, in their order.

        Logits (B, K, C), -∞ behind the last of a frame, and boxes (B, K, 7). On a GPU all anchors,
        as its host would have to wait for the number."""
        if not output.logits.is_cpu:
            return self.decode(output)
        frame, anchor = (output.logits.amax(dim=2) >= lowest).nonzero(as_tuple=True)
        counts = frame.bincount(minlength=len(output.logits))
        place = frame, torch.arange(len(frame)) - (counts.cumsum(0) - counts)[frame]
        shape = len(counts), int(counts.max())
        logits = output.logits.new_full((*shape, len(self.classes)), -torch.inf)
        boxes = logits.new_zeros(*shape, 7)
        logits[place] = output.logits[frame, anchor]
        anchors = self.anchors.reshape(-1, 7)[anchor]
        boxes[place] = _boxes(*self.raw_boxes(output, (frame, anchor)), anchors)
        return logits, boxes


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

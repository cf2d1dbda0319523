"""Base of the second stages: proposals, their sample, losses, refined boxes, detections."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.detectors.detector import Selection
from training.detectors.heads.losses import BETA
from training.detectors.heads.proposals import Proposals, Suppression, propose
from training.detectors.heads.roi_box_coder import decode_in_rois, encode_in_rois, turned
from training.detectors.heads.roi_targets import RoiSampling, RoiTargets
from training.detectors.heads.selection import detections, select_rows
from training.ops.nms import rows_of


@dataclass(frozen=True)
class RoiSettings:
    """Proposals of a second stage and its training."""

    train: Suppression  # how proposals are chosen in training
    test: Suppression  # and in evaluation
    sampling: RoiSampling = field(default_factory=RoiSampling)  # which of them are trained on


@dataclass(frozen=True)
class RoiOutput:
    """Raw outputs for B * R RoIs: logits (B * R, 1) and residuals (B * R, 7), at least float32.

    A head that only scores its RoIs has no residuals."""

    logits: Tensor
    residuals: Tensor | None


class RoiHead(nn.Module):
    """Base of the second stages; derived ones have a `forward` from RoIs to RoiOutput."""

    __call__: Callable[..., RoiOutput]

    def __init__(self, settings: RoiSettings) -> None:
        super().__init__()
        self.settings = settings

    def propose(self, logits: Tensor, boxes: Tensor) -> Proposals:
        """Propose boxes by the settings for training, or for evaluation."""
        return propose(logits, boxes, self.settings.train if self.training else self.settings.test)

    def loss(self, output: RoiOutput, targets: RoiTargets) -> dict[str, Tensor]:
        """Compute "rcnn_cls", cross entropy of the RoIs that learn a score.

        If there are residuals, also "rcnn_reg", smooth L1, and "rcnn_corner" of those that learn a
        box."""
        scores = targets.scores.flatten()
        cross_entropy = functional.binary_cross_entropy_with_logits(
            output.logits.flatten(), scores.clamp_min(0), reduction="none"
        )
        scored = scores >= 0
        losses = {"rcnn_cls": (cross_entropy * scored).sum() / scored.sum().clamp_min(1)}
        if output.residuals is None:
            return losses
        # All RoIs, as a GPU's host would have to wait for the number of those that learn a box.
        learns = targets.regress.flatten()
        residuals = output.residuals.where(learns[:, None], 0)
        rois, boxes = (part.flatten(0, 1) for part in (targets.rois.boxes, targets.boxes))
        expected = encode_in_rois(boxes, rois)
        box = functional.smooth_l1_loss(residuals, expected, reduction="none", beta=BETA)
        corner = corner_loss(decode_in_rois(residuals, rois), boxes)
        count = learns.sum().clamp_min(1)
        means = ((part * learns).sum() / count for part in (box.sum(dim=1), corner))
        return losses | dict(zip(("rcnn_reg", "rcnn_corner"), means, strict=True))

    def refine(self, output: RoiOutput, rois: Tensor) -> Tensor:
        """Boxes of the second stage for RoIs (B, R, 7), same shape."""
        if output.residuals is None:
            return rois
        return decode_in_rois(output.residuals.view(rois.shape), rois)

    def detections(
        self, output: RoiOutput, proposals: Proposals, selection: Selection
    ) -> list[dict[str, Tensor]]:
        """Results of `Detector.predict`: refined boxes with the second stage's scores.

        What fills up the proposals is no detection, nor a box that is not finite."""
        refined = self.refine(output, proposals.boxes)
        real = (proposals.boxes[..., 3:6] > 0).all(dim=-1) & refined.isfinite().all(dim=-1)
        logits = output.logits.view(real.shape).masked_fill(~real, -torch.inf)
        rows, counts = select_rows(logits, refined, selection)
        order = real.logical_not().byte().argsort(dim=1, stable=True)
        # The only wait for a GPU.
        detected, proposed = torch.stack([counts, real.sum(dim=1)]).tolist()
        frames = detections(refined, logits, proposals.labels, rows, detected)
        usable = zip(rows_of(refined, order), proposed, strict=True)
        return [
            frame | {"refined": boxes[:count]}
            for frame, (boxes, count) in zip(frames, usable, strict=True)
        ]


def corner_loss(boxes: Tensor, expected: Tensor) -> Tensor:
    """Mean Huber loss of the distances of the eight corners of boxes (P, 7), shape (P,).

    Qi et al., Frustum PointNets, CVPR 2018, section 4.4: a corner may be near the one of the
    expected box or of that box turned by 180°."""
    corners = _corners(boxes)
    half_turn = torch.cat([expected[:, :6], expected[:, 6:] + math.pi], dim=1)
    distance = torch.minimum(
        torch.linalg.vector_norm(corners - _corners(expected), dim=-1),
        torch.linalg.vector_norm(corners - _corners(half_turn), dim=-1),
    )
    return functional.huber_loss(distance, torch.zeros_like(distance), reduction="none").mean(dim=1)


def _corners(boxes: Tensor) -> Tensor:
    """The corners (P, 8, 3) of boxes (P, 7)."""
    half = torch.arange(2, dtype=boxes.dtype, device=boxes.device) - 0.5
    offsets = torch.cartesian_prod(half, half, half) * boxes[:, None, 3:6]
    return turned(offsets, boxes[:, 6]) + boxes[:, None, :3]

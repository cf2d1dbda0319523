"""Which proposals a second stage is trained on, and what each of them has to learn."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from training.detectors.heads.proposals import Proposals
from training.ops.box_overlap import iou_3d


@dataclass(frozen=True)
class RoiSampling:
    """How RoIs are sampled and labelled (OpenPCDet's TARGET_CONFIG; its values as defaults).

    A RoI's IoU is its largest 3D IoU with an object of its own class.

    Attributes:
        score: what the score learns. "cls": 1 above `cls_foreground`, 0 up to `cls_background`,
            nothing between. "roi_iou": the IoU, scaled so that it rises from 0 to 1 between them.
        cls_foreground, cls_background: IoU, see `score`.
        rois: RoIs per frame (ROI_PER_IMAGE).
        foreground: at most this share of them is foreground (FG_RATIO).
        regression: a RoI with at least this IoU is foreground and learns its object's box.
        easy: a RoI with less than this IoU is easy background, between the two it is hard.
        hard_share: of the background, the share that is hard (HARD_BG_RATIO).
    """

    score: Literal["cls", "roi_iou"] = "roi_iou"
    cls_foreground: float = 0.75
    cls_background: float = 0.25
    rois: int = 128
    foreground: float = 0.5
    regression: float = 0.55
    easy: float = 0.1
    hard_share: float = 0.8


@dataclass(frozen=True)
class RoiTargets:
    """The sampled RoIs of B frames, R each, and what they have to learn.

    Attributes:
        rois: the sample.
        boxes: object that each RoI overlaps most, (B, R, 7), zeros in a frame without objects.
        iou: 3D IoU with it, (B, R).
        scores: what the score has to become, from 0 to 1, (B, R); -1 for nothing.
        regress: whether the RoI learns its object's box, (B, R), bool.
    """

    rois: Proposals
    boxes: Tensor
    iou: Tensor
    scores: Tensor
    regress: Tensor


@torch.no_grad()
def sample_rois(
    proposals: Proposals, boxes: Sequence[Tensor], labels: Sequence[Tensor], sampling: RoiSampling
) -> RoiTargets:
    """Draw `sampling.rois` proposals of every frame with torch's default CPU generator.

    As OpenPCDet's ProposalTargetLayer: foreground without replacement, background with.

    Args:
        boxes, labels: objects of each frame, (M, 7) and (M,), labels from 1.
    """
    frames = [
        _sample_in_frame(
            Proposals(proposals.boxes[b], proposals.scores[b], proposals.labels[b]),
            frame_boxes.to(proposals.boxes),
            frame_labels.to(proposals.labels),
            sampling,
        )
        for b, (frame_boxes, frame_labels) in enumerate(zip(boxes, labels, strict=True))
    ]
    rois = Proposals(
        torch.stack([frame.boxes for frame, _, _ in frames]),
        torch.stack([frame.scores for frame, _, _ in frames]),
        torch.stack([frame.labels for frame, _, _ in frames]),
    )
    objects = torch.stack([item for _, item, _ in frames])
    iou = torch.stack([item for _, _, item in frames])
    return RoiTargets(rois, objects, iou, score_targets(iou, sampling), iou > sampling.regression)


def score_targets(iou: Tensor, sampling: RoiSampling) -> Tensor:
    """What the scores of RoIs with this IoU have to become, same shape; -1 for nothing."""
    low, high = sampling.cls_background, sampling.cls_foreground
    if sampling.score == "roi_iou":
        return ((iou - low) / (high - low)).clamp(0, 1)
    target = (iou > high).to(iou)
    target[(iou > low) & (iou < high)] = -1
    return target


def _sample_in_frame(
    proposals: Proposals, boxes: Tensor, labels: Tensor, sampling: RoiSampling
) -> tuple[Proposals, Tensor, Tensor]:
    """The sample of one frame, its objects (R, 7) and IoU (R,)."""
    if len(boxes) == 0:  # a maximum needs something to choose from
        boxes, labels = boxes.new_zeros(1, 7), labels.new_zeros(1)
    same = proposals.labels[:, None] == labels
    iou, best = (iou_3d(proposals.boxes, boxes) * same).max(dim=1)
    rows = _draw(iou.cpu(), sampling).to(iou.device)
    sample = Proposals(proposals.boxes[rows], proposals.scores[rows], proposals.labels[rows])
    return sample, boxes[best[rows]], iou[rows]


def _draw(iou: Tensor, sampling: RoiSampling) -> Tensor:
    """Rows of the sample: foreground, hard background, easy background."""
    foreground = torch.nonzero(iou >= sampling.regression).flatten()
    hard = torch.nonzero((iou < sampling.regression) & (iou >= sampling.easy)).flatten()
    easy = torch.nonzero(iou < sampling.easy).flatten()
    if len(hard) + len(easy) == 0:
        return _with_replacement(foreground, sampling.rois)
    wanted = round(sampling.foreground * sampling.rois)
    foreground = foreground[torch.randperm(len(foreground))[:wanted]]
    background = sampling.rois - len(foreground)
    if len(easy) == 0:
        hard_count = background
    else:
        hard_count = min(int(background * sampling.hard_share), len(hard))
    return torch.cat(
        [
            foreground,
            _with_replacement(hard, hard_count),
            _with_replacement(easy, background - hard_count),
        ]
    )


def _with_replacement(rows: Tensor, count: int) -> Tensor:
    return rows[torch.randint(max(1, len(rows)), (count,))]

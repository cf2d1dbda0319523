"""Sample of the proposals on which a second stage is trained, and its targets."""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from training.detectors.detector import Rows
from training.detectors.heads.proposals import Proposals
from training.ops.box_overlap import iou_3d


@dataclass(frozen=True)
class RoiSampling:
    """Rule by which RoIs are sampled and labelled (OpenPCDet's TARGET_CONFIG and its values).

    A RoI's IoU is its largest 3D IoU with an object of its own class."""

    # What the score learns. "cls": 1 above `cls_foreground`, 0 up to `cls_background`, nothing
    # between. "roi_iou": the IoU, scaled so that it rises from 0 to 1 between them
    score: Literal["cls", "roi_iou"] = "roi_iou"
    cls_foreground: float = 0.75
    cls_background: float = 0.25
    rois: int = 128  # RoIs per frame (ROI_PER_IMAGE)
    foreground: float = 0.5  # at most this share of them is foreground (FG_RATIO)
    regression: float = 0.55  # with at least this IoU it is foreground and learns its object's box
    easy: float = 0.1  # with less than this IoU it is easy background, between the two hard
    hard_share: float = 0.8  # of the background, the share that is hard (HARD_BG_RATIO)


@dataclass(frozen=True)
class RoiTargets:
    """The sampled RoIs of B frames, R each, and what they have to learn."""

    rois: Proposals  # the sample
    boxes: Tensor  # object that each RoI overlaps most, (B, R, 7), zeros in a frame without objects
    scores: Tensor  # what the score has to become, from 0 to 1, (B, R); -1 for nothing
    regress: Tensor  # whether the RoI learns its object's box, (B, R), bool


@torch.no_grad()
def sample_rois(
    proposals: Proposals, boxes: Rows, labels: Rows, sampling: RoiSampling
) -> RoiTargets:
    """Draw `sampling.rois` proposals of every frame with torch's default CPU generator.

    As OpenPCDet's ProposalTargetLayer: foreground without replacement, background with. The objects
    of a frame are `boxes` (M, 7) and `labels` (M,), from 1."""
    frames = zip(*proposals, boxes, labels, strict=True)
    samples = [_sample_in_frame(Proposals(*frame[:3]), *frame[3:], sampling) for frame in frames]
    *rois, objects, iou = map(torch.stack, zip(*samples, strict=True))
    scores, regress = score_targets(iou, sampling), iou > sampling.regression
    return RoiTargets(Proposals(*rois), objects, scores, regress)


def score_targets(iou: Tensor, sampling: RoiSampling) -> Tensor:
    """Scores that RoIs with these IoUs have to learn, same shape; -1 for nothing."""
    low, high = sampling.cls_background, sampling.cls_foreground
    if sampling.score == "roi_iou":
        return ((iou - low) / (high - low)).clamp(0, 1)
    target = (iou > high).to(iou)
    target[(iou > low) & (iou < high)] = -1
    return target


def _sample_in_frame(
    proposals: Proposals, boxes: Tensor, labels: Tensor, sampling: RoiSampling
) -> tuple[Tensor, ...]:
    """The sample of one frame, its objects (R, 7) and IoU (R,)."""
    boxes, labels = boxes.to(proposals.boxes), labels.to(proposals.labels)
    if len(boxes) == 0:  # a maximum needs something to choose from
        boxes, labels = boxes.new_zeros(1, 7), labels.new_zeros(1)
    same = proposals.labels[:, None] == labels
    iou, best = (iou_3d(proposals.boxes, boxes) * same).max(dim=1)
    rows = _draw(iou.cpu(), sampling).to(iou.device)
    return *(part[rows] for part in proposals), boxes[best[rows]], iou[rows]


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
    difficult = min(int(background * sampling.hard_share), len(hard)) if len(easy) else background
    hard, easy = _with_replacement(hard, difficult), _with_replacement(easy, background - difficult)
    return torch.cat([foreground, hard, easy])


def _with_replacement(rows: Tensor, count: int) -> Tensor:
    return rows[torch.randint(max(1, len(rows)), (count,))]

"""Sample of the proposals on which a second stage is trained, and its targets."""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor
from torch.nn import functional
from torch.nn.utils.rnn import pad_sequence

from training.detectors.detector import Rows
from training.detectors.heads.proposals import Proposals
from training.ops.box_overlap import iou_3d
from training.ops.nms import rows_of


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
    # One more box, of zeros and no class: a maximum needs something to choose from.
    objects = functional.pad(pad_sequence(list(boxes), batch_first=True), (0, 0, 0, 1))
    objects = objects.to(proposals.boxes)
    object_labels = functional.pad(pad_sequence(list(labels), batch_first=True), (0, 1))
    same = proposals.labels[..., None] == object_labels[:, None].to(proposals.labels)
    iou, best = (iou_3d(proposals.boxes, objects) * same).max(dim=2)
    drawn = torch.stack([_draw(frame, sampling) for frame in iou.cpu()])
    rows = drawn.to(iou.device, non_blocking=True)
    rois, iou = Proposals(*(rows_of(part, rows) for part in proposals)), rows_of(iou, rows)
    scores, regress = score_targets(iou, sampling), iou > sampling.regression
    return RoiTargets(rois, rows_of(objects, rows_of(best, rows)), scores, regress)


def score_targets(iou: Tensor, sampling: RoiSampling) -> Tensor:
    """Scores that RoIs with these IoUs have to learn, same shape; -1 for nothing."""
    low, high = sampling.cls_background, sampling.cls_foreground
    if sampling.score == "roi_iou":
        return ((iou - low) / (high - low)).clamp(0, 1)
    return (iou > high).to(iou).masked_fill((iou > low) & (iou < high), -1)


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

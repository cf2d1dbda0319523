"""The second stage of PointRCNN: a PointNet++ on the points in each proposal.

PointRCNN (Shi et al., CVPR 2019), section 3.3."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from training.detectors.backbones.pointnet2 import AbstractionLevels, AbstractionSettings
from training.detectors.backbones.set_abstraction import GlobalAbstraction
from training.detectors.heads.roi_box_coder import turned
from training.detectors.heads.roi_head import RoiHead, RoiOutput, RoiSettings
from training.detectors.layers import RowConv1d, RowConv2d, precise, row_layers
from training.ops.grouping import group
from training.ops.points_in_boxes import points_of_boxes

DEPTH_SCALE = 70.0  # a point's distance from the sensor enters as a share of this, metres


@dataclass(frozen=True, kw_only=True)
class PointRoiSettings(RoiSettings):
    """Settings of a PointRCNNHead."""

    points: int  # of each proposal, chosen or repeated
    margin: float  # points so far outside belong to it, too, counting both sides, metres
    local: tuple[int, ...]  # outputs of the layers on a point's place, score and depth
    levels: tuple[AbstractionSettings, ...]  # set abstraction within a proposal
    mlp: tuple[int, ...]  # outputs of the layers before the maximum over a whole proposal
    hidden: tuple[int, ...]  # outputs of the hidden layers of the score's branch, and of the box's


@dataclass(frozen=True)
class ScoredPoints:
    """The points of a batch as the first stage leaves them, frame after frame."""

    xyz: Tensor  # (N, 3), metres
    counts: Sequence[int]  # points of each frame
    features: Tensor  # (N, C)
    scores: Tensor  # largest probability of a class, (N,)


class PointRCNNHead(RoiHead):
    """Scores and refines each proposal by what the points in it look like from its own frame."""

    def __init__(self, inputs: int, settings: PointRoiSettings) -> None:
        super().__init__(settings)
        self.points, self.margin = settings.points, settings.margin
        self.xyz_up_layer = nn.Sequential(*_layers([5, *settings.local]))
        self.merge_down_layer = nn.Sequential(*_layers([settings.local[-1] + inputs, inputs]))
        self.SA_modules = AbstractionLevels(inputs, settings.levels)
        self.SA_modules.append(GlobalAbstraction(self.SA_modules.channels[-1], settings.mlp))
        self.cls_layers, self.reg_layers = (
            row_layers(settings.mlp[-1], settings.hidden, dropout=0.0).append(last)
            for last in (RowConv1d(settings.hidden[-1], 1), RowConv1d(settings.hidden[-1], 7))
        )
        for layer in self.modules():
            if isinstance(layer, (RowConv1d, RowConv2d)):
                nn.init.xavier_normal_(layer.weight)
                if layer.bias is not None:
                    nn.init.zeros_(layer.bias)
        nn.init.normal_(self.reg_layers[-1].weight, std=0.001)  # type: ignore[arg-type]

    def forward(self, rois: Tensor, points: ScoredPoints) -> RoiOutput:
        """Raw outputs for RoIs (B, R, 7)."""
        pooled = self.pool(rois, points)
        xyz, features = pooled[..., :3], pooled[..., 5:].flatten(0, 1)
        local = self.xyz_up_layer(pooled[..., :5].flatten(0, 1))
        features = self.merge_down_layer(torch.cat([local, features], dim=1))
        counts = [self.points] * len(pooled)
        xyz, _, features = self.SA_modules.descend(xyz.flatten(0, 1), counts, features)[-1]
        shape = len(pooled), xyz.shape[0] // len(pooled)
        whole = self.SA_modules[-1](xyz.view(*shape, 3), features.view(*shape, -1))
        return RoiOutput(precise(self.cls_layers(whole)), precise(self.reg_layers(whole)))

    @torch.no_grad()
    def pool(self, rois: Tensor, points: ScoredPoints) -> Tensor:
        """Points in each RoI, (B * R, points, 5 + C), zeros in a RoI without any.

        Place in the RoI's frame, score, depth, features. No gradient goes back to the first stage,
        as in OpenPCDet."""
        depth = torch.linalg.vector_norm(points.xyz, dim=1) / DEPTH_SCALE - 0.5
        scores_and_depths = torch.stack([points.scores, depth], dim=1)
        rows = torch.cat([scores_and_depths, points.features.to(depth.dtype)], dim=1)
        pooled, empty = pool_points(points.xyz, points.counts, rows, rois, self.points, self.margin)
        rois = rois.flatten(0, 1)
        place = turned(pooled[..., :3] - rois[:, None, :3], -rois[:, 6])
        pooled = torch.cat([place, pooled[..., 3:]], dim=2)
        return pooled.masked_fill_(empty[:, None, None], 0)


def pool_points(
    points: Tensor,
    counts: Sequence[int],
    features: Tensor,
    boxes: Tensor,
    samples: int,
    extra: float,
) -> tuple[Tensor, Tensor]:
    """Pool the first S of the finite points of a frame, in their order, in each box (B, R, 7).

    OpenPCDet's roipoint_pool: a box with fewer repeats them in their order; `extra` metres are
    added to its sides before. Points (N, 3) are frame after frame, `counts` of them.

    Returns coordinates and features, (B * R, S, 3 + C), zeros where there is no point; and which
    boxes are empty, (B * R,) bool. Gradients flow to `features` (N, C)."""
    large = boxes.detach().to(points).clone()
    large[..., 3:6] += extra
    idx, empty = points_of_boxes(points, counts, large, samples)
    pooled = torch.cat([group(points, idx), group(features, idx)], dim=2)
    return pooled.masked_fill(empty[:, None, None], 0), empty


def _layers(channels: Sequence[int]) -> list[nn.Module]:
    layers: list[nn.Module] = []
    for before, after in pairwise(channels):
        layers += [RowConv2d(before, after, 1), nn.ReLU(inplace=True)]
    return layers

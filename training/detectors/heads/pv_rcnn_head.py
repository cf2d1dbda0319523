"""The second stage of PV-RCNN: keypoints pooled to a grid in each RoI.

PV-RCNN (Shi et al., CVPR 2020), section 3.3."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from training.detectors.backbones.set_abstraction import BallSettings, SetAbstraction
from training.detectors.backbones.voxel_set_abstraction import Keypoints
from training.detectors.heads.roi_box_coder import roi_grid
from training.detectors.heads.roi_head import RoiHead, RoiOutput, RoiSettings
from training.detectors.layers import RowConv1d, precise, row_layers
from training.ops.grouping import stacked_counts


@dataclass(frozen=True, kw_only=True)
class PvRcnnHeadSettings(RoiSettings):
    """Settings of a PvRcnnHead."""

    grid: int  # grid points along each axis of a RoI
    balls: BallSettings  # of keypoints around a grid point
    shared: tuple[int, ...]  # outputs of the common hidden layers
    branch: tuple[int, ...]  # and of those of the score's and the box's branches
    dropout: float  # share of a hidden layer's outputs that training drops


class PvRcnnHead(RoiHead):
    """Score and box of each RoI from the keypoints in and around it; `inputs` features each."""

    def __init__(self, inputs: int, settings: PvRcnnHeadSettings) -> None:
        super().__init__(settings)
        self.grid = settings.grid
        self.roi_grid_pool_layer = SetAbstraction(inputs, settings.balls)
        pooled = self.roi_grid_pool_layer.outputs * settings.grid**3
        self.shared_fc_layer = row_layers(pooled, settings.shared, settings.dropout)
        score, box = (RowConv1d(settings.branch[-1], outputs) for outputs in (1, 7))
        self.cls_layers, self.reg_layers = (
            row_layers(settings.shared[-1], settings.branch, settings.dropout).append(last)
            for last in (score, box)
        )
        for module in self.roi_grid_pool_layer.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.xavier_normal_(module.weight)
        nn.init.xavier_normal_(score.weight)
        # Untrained, the boxes of the second stage are those of the first.
        nn.init.normal_(box.weight, std=0.001)
        for last in (score, box):
            nn.init.zeros_(last.bias)

    def forward(self, keypoints: Keypoints, foreground: Tensor, rois: Tensor) -> RoiOutput:
        """Raw outputs for RoIs (B, R, 7); keypoints count by `foreground` (K, 1), probabilities."""
        frames, count = rois.shape[:2]
        places = roi_grid(rois.flatten(0, 1), self.grid)
        pooled = self.roi_grid_pool_layer(
            keypoints.xyz,
            stacked_counts(keypoints.counts, rois.device),
            keypoints.features * foreground,
            places.flatten(0, 1),
            rois.new_full((frames,), count * self.grid**3, dtype=torch.int64),
        )
        # Grid points last, in the order of OpenPCDet's weights.
        rows = pooled.view(frames * count, self.grid**3, -1).transpose(1, 2).flatten(1)
        shared = self.shared_fc_layer(rows)
        return RoiOutput(precise(self.cls_layers(shared)), precise(self.reg_layers(shared)))

"""The second stage of SECOND-IoU: how well each proposal fits its object."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.detectors.heads.roi_head import RoiHead, RoiOutput, RoiSettings
from training.detectors.layers import RowConv1d, precise, row_layers


@dataclass(frozen=True, kw_only=True)
class SecondIouSettings(RoiSettings):
    """Settings of a SecondIouHead."""

    grid: int = 7  # places of a RoI along its length and its width
    shared: tuple[int, ...] = (256, 256)  # outputs of the hidden layers
    iou: tuple[int, ...] = (256, 256)
    dropout: float = 0.3  # share of the features that are zero in training


class SecondIouHead(RoiHead):
    """Scores RoIs from the image of the 2D backbone; their boxes stay.

    The image has `inputs` channels, its first corner at x, y and square cells, metres."""

    def __init__(
        self, inputs: int, corner: tuple[float, float], cell: float, settings: SecondIouSettings
    ) -> None:
        super().__init__(settings)
        self.corner, self.cell, self.size = corner, cell, settings.grid
        shared, hidden, dropout = settings.shared, settings.iou, settings.dropout
        self.shared_fc_layer = row_layers(inputs * settings.grid**2, shared, dropout)
        last = RowConv1d(hidden[-1], 1)
        nn.init.xavier_normal_(last.weight)
        nn.init.zeros_(last.bias)
        self.iou_layers = row_layers(shared[-1], hidden, dropout).append(last)

    def forward(self, rois: Tensor, image: Tensor) -> RoiOutput:
        """Logits of the IoU of RoIs (B, R, 7) from an image (B, C, ny, nx), without residuals."""
        # As upstream, the second stage does not train the first.
        pooled = bev_pool(image.detach(), rois, self.corner, self.cell, self.size)
        logits = self.iou_layers(self.shared_fc_layer(pooled.flatten(1)))
        return RoiOutput(precise(logits), None)


def bev_pool(
    image: Tensor, rois: Tensor, corner: tuple[float, float], cell: float, size: int
) -> Tensor:
    """Features (B * R, C, size, size) of an image (B, C, ny, nx) on grids in RoIs (B, R, 7).

    The grids reach from edge to edge of the RoIs. Bilinear, zero outside the image. As OpenPCDet's
    SECONDHead: features lie at the cells' lower corners, and offsets along x are scaled by the
    RoI's length, those along y by its width, after the turn and not before."""
    last = rois.new_tensor([image.shape[3] - 1, image.shape[2] - 1])
    low = rois.new_tensor(corner)
    near, far = ((rois[..., :2] + end * rois[..., 3:5] - low) / cell for end in (-0.5, 0.5))
    extent, centre = (far - near) / last, (near + far - last) / last
    cos, sin = torch.cos(rois[..., 6]), torch.sin(rois[..., 6])
    turn = torch.stack([cos, -sin, sin, cos], dim=-1).unflatten(-1, (2, 2))
    theta = torch.cat([extent[..., None] * turn, centre[..., None]], dim=-1)
    places = functional.affine_grid(
        theta.flatten(0, 1), [theta.shape[:2].numel(), 1, size, size], align_corners=True
    )
    # All RoIs of a frame are one tall grid.
    pooled = functional.grid_sample(
        image.to(rois.dtype), places.view(len(rois), -1, size, 2), align_corners=True
    )
    return pooled.permute(0, 2, 3, 1).reshape(len(places), size, size, -1).permute(0, 3, 1, 2)

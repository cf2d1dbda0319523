"""The 2D convolutional backbone of SECOND and PointPillars."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn


@dataclass(frozen=True)
class BackboneSettings:
    """Blocks of convolutions, each followed by an up-sampling branch."""

    layers: tuple[int, ...]  # 3 × 3 convolutions of each block after its first
    strides: tuple[int, ...]  # of each block's first convolution
    filters: tuple[int, ...]  # channels of each block
    up_strides: tuple[int, ...]  # how far each block's output is enlarged
    up_filters: tuple[int, ...]  # channels that each block contributes to the output
    momentum: float = 0.01  # of batch norm

    @property
    def total_stride(self) -> int:
        """The input's height and width must be multiples of this."""
        return math.prod(self.strides)

    @property
    def outputs(self) -> int:
        """Channels of the output."""
        return sum(self.up_filters)


class Backbone2d(nn.Module):
    """Convolutions at falling resolution, brought together at the first block's."""

    def __init__(self, inputs: int, settings: BackboneSettings) -> None:
        super().__init__()
        self.blocks = nn.ModuleList()
        self.deblocks = nn.ModuleList()
        channels = inputs
        for i, filters in enumerate(settings.filters):
            layers: list[nn.Module] = [
                # In place of upstream's padding layer: keeps the state_dict's numbering.
                nn.Identity(),
                nn.Conv2d(channels, filters, 3, settings.strides[i], padding=1, bias=False),
                *_norm_relu(filters, settings.momentum),
            ]
            for _ in range(settings.layers[i]):
                layers.append(nn.Conv2d(filters, filters, 3, padding=1, bias=False))
                layers.extend(_norm_relu(filters, settings.momentum))
            self.blocks.append(nn.Sequential(*layers))
            up, out = settings.up_strides[i], settings.up_filters[i]
            enlarge = nn.ConvTranspose2d(filters, out, up, up, bias=False)
            self.deblocks.append(nn.Sequential(enlarge, *_norm_relu(out, settings.momentum)))
            channels = filters

    def forward(self, image: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, outputs, h, w), h = H / strides[0] * up_strides[0]."""
        branches = []
        for block, deblock in zip(self.blocks, self.deblocks, strict=True):
            image = block(image)
            branches.append(deblock(image))
        return torch.cat(branches, dim=1)


def _norm_relu(channels: int, momentum: float) -> list[nn.Module]:
    return [nn.BatchNorm2d(channels, eps=1e-3, momentum=momentum), nn.ReLU(inplace=True)]

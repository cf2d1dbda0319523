"""The 2D convolutional backbone of SECOND and PointPillars."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn


@dataclass(frozen=True)
class BackboneSettings:
    """Blocks of convolutions, each followed by an up-sampling branch.

    Attributes:
        layers: 3 × 3 convolutions of each block after its first.
        strides: of each block's first convolution.
        filters: channels of each block.
        upsample_strides: how far each block's output is enlarged.
        upsample_filters: channels that each block contributes to the output.
        momentum: of batch norm.
    """

    layers: tuple[int, ...]
    strides: tuple[int, ...]
    filters: tuple[int, ...]
    upsample_strides: tuple[int, ...]
    upsample_filters: tuple[int, ...]
    momentum: float = 0.01

    @property
    def total_stride(self) -> int:
        """The input's height and width must be multiples of this."""
        total = 1
        for stride in self.strides:
            total *= stride
        return total

    @property
    def outputs(self) -> int:
        """Channels of the output."""
        return sum(self.upsample_filters)


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
            up, out = settings.upsample_strides[i], settings.upsample_filters[i]
            self.deblocks.append(
                nn.Sequential(
                    nn.ConvTranspose2d(filters, out, up, up, bias=False),
                    *_norm_relu(out, settings.momentum),
                )
            )
            channels = filters

    def forward(self, image: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, outputs, h, w), h = H / strides[0] * upsample_strides[0]."""
        branches = []
        for block, deblock in zip(self.blocks, self.deblocks, strict=True):
            image = block(image)
            branches.append(deblock(image))
        return torch.cat(branches, dim=1)


def _norm_relu(channels: int, momentum: float) -> list[nn.Module]:
    return [nn.BatchNorm2d(channels, eps=1e-3, momentum=momentum), nn.ReLU()]

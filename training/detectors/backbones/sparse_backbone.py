"""The sparse 3D backbone of SECOND: four scales, each half as fine as the one before."""

import torch
from torch import nn

from training.detectors.layers import PaddedBatchNorm
from training.ops.sparse_conv import SparseConv3d, SparseTensor, SubmanifoldConv3d
from training.ops.sparse_rules import Triple

STRIDE = 8  # voxels along x or y per cell of the encoded grid


class SparseBlock(nn.Sequential):
    """Convolution, batch norm and ReLU."""

    def __init__(self, convolution: SubmanifoldConv3d | SparseConv3d, momentum: float) -> None:
        channels = convolution.weight.shape[0]
        norm = PaddedBatchNorm(channels, eps=1e-3, momentum=momentum)
        super().__init__(convolution, norm, nn.ReLU())

    def forward(self, x: SparseTensor) -> SparseTensor:
        """(N, inputs) to (M, outputs)."""
        convolution, norm, relu = self
        x = convolution(x)
        return x.with_features(relu(norm(x.features)))


class VoxelBackBone8x(nn.Module):
    """Sparse convolutions from voxels to a grid of 1/8 of their number in x and y.

    Yan et al., SECOND: sparsely embedded convolutional detection, Sensors 2018, section 3.1.2.
    `channels` are those of the four scales and of the result."""

    def __init__(
        self, inputs: int, channels: tuple[int, int, int, int, int], momentum: float = 0.01
    ) -> None:
        super().__init__()

        def same(before: int, after: int) -> SparseBlock:
            return SparseBlock(SubmanifoldConv3d(before, after), momentum)

        def halved(before: int, after: int, padding: Triple) -> nn.Sequential:
            down = SparseBlock(SparseConv3d(before, after, (3, 3, 3), (2, 2, 2), padding), momentum)
            return nn.Sequential(down, same(after, after), same(after, after))

        one, two, three, four, out = channels
        self.conv_input = same(inputs, one)
        self.conv1 = nn.Sequential(same(one, one))
        self.conv2 = halved(one, two, (1, 1, 1))
        self.conv3 = halved(two, three, (1, 1, 1))
        self.conv4 = halved(three, four, (0, 1, 1))
        last = SparseConv3d(four, out, (3, 1, 1), (2, 1, 1), (0, 0, 0))
        self.conv_out = SparseBlock(last, momentum)

    def forward(self, voxels: SparseTensor) -> dict[str, SparseTensor]:
        """Compute "x_conv1" … "x_conv4", strides 1, 2, 4, 8, and "encoded", stride 8, low."""
        # Coordinates are features here, and 16 bits would round them to 25 cm at the far end.
        with torch.autocast(voxels.features.device.type, enabled=False):
            x = self.conv_input(voxels)
        blocks = (self.conv1, self.conv2, self.conv3, self.conv4, self.conv_out)
        names = ("x_conv1", "x_conv2", "x_conv3", "x_conv4", "encoded")
        return {name: (x := block(x)) for name, block in zip(names, blocks, strict=True)}


def encoded_height(height: int) -> int:
    """Layers of the encoded grid over voxels that are `height` cells high; can be below 1."""
    for kernel, stride, padding in ((3, 2, 1), (3, 2, 1), (3, 2, 0), (3, 2, 0)):
        height = (height + 2 * padding - kernel) // stride + 1
    return height

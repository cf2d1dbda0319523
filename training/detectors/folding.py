"""Batch norm folded into the layers before it: what evaluation need not compute again and again."""

from itertools import pairwise

from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval


def fold_batch_norm(model: nn.Module) -> None:
    """Fold batch norm into the 2D convolutions of sequences: convolution, batch norm, ReLU.

    In place, for good: the model then predicts what it did, up to rounding, and cannot be trained.
    ReLUs write over what the convolutions gave them.
    """
    model.eval()
    for layers in model.modules():
        if not isinstance(layers, nn.Sequential):
            continue
        for index, (layer, norm) in enumerate(pairwise(list(layers))):
            if not isinstance(norm, nn.BatchNorm2d):
                continue
            assert isinstance(layer, nn.Conv2d | nn.ConvTranspose2d)
            transposed = isinstance(layer, nn.ConvTranspose2d)
            layers[index] = fuse_conv_bn_eval(layer, norm, transposed)
            layers[index + 1] = nn.Identity()
            layers[index + 2] = nn.ReLU(inplace=True)

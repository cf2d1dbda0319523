"""The image of pillars in one pass over the points: evaluation on a CPU.

What `group`, `PillarEncoder` and `scatter` do one after the other, without a row for every point. A
point's features are linear in its offset from the pillar's centre and its intensity, but for what
all points of the pillar share: its centre, and where the mean of its points lies. So, with batch
norm folded into the weights, the maximum over the pillar is that of four products a point and
channel, and the rest is added once. A maximum asks for no order: points stay unsorted.
"""

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.utils.fusion import fuse_linear_bn_weights

from lidarplace.base.kernel_cache import njit
from training.detectors.backbones.pillars import PillarEncoder, PillarFeatureLayer


class _Weights(NamedTuple):
    """What C channels take of a point and of its pillar; float arrays.

    Attributes:
        point: of offset from the centre and intensity, shape (4, C).
        centre: of the pillar's centre, shape (3, C).
        mean: of the offset of the mean from the centre, shape (3, C).
        bias: shape (C,).
    """

    point: NDArray[np.floating]
    centre: NDArray[np.floating]
    mean: NDArray[np.floating]
    bias: NDArray[np.floating]


def pillar_image(frames: Sequence[Tensor], encoder: PillarEncoder) -> Tensor:
    """Pillars of frames of points (N, 4) as an image (frames, C, ny, nx), channels last in memory.

    That of `scatter` for an encoder in evaluation, up to rounding, in the dtype of its weights.
    These are on a CPU; gradients do not flow.
    """
    grid = encoder.grid
    nx, ny = grid.shape
    weights = _folded(cast(PillarFeatureLayer, encoder.pfn_layers[0]))
    x, _, z = grid.centres(torch.arange(nx)).T.numpy()
    _, y, _ = grid.centres(nx * torch.arange(ny)).T.numpy()
    image = np.zeros((len(frames), ny * nx, encoder.filters), weights.bias.dtype)
    # What upstream fills a pillar up with goes through batch norm, too.
    padding = weights.bias if grid.max_points else np.zeros_like(weights.bias)
    for frame, pixels in zip(frames, image, strict=True):
        points = frame.detach().cpu().numpy().astype(np.float32, copy=False)
        _fill(
            points, grid.cells(points), (x, y, z[0]), grid.limits(False), weights, padding, pixels
        )
    return torch.from_numpy(image).view(len(frames), ny, nx, -1).permute(0, 3, 1, 2)


def _folded(layer: PillarFeatureLayer) -> _Weights:
    """The weights of a linear layer and its batch norm, brought into the terms of `_Weights`."""
    norm = layer.norm
    assert norm.running_mean is not None
    assert norm.running_var is not None
    weight, bias = fuse_linear_bn_weights(
        layer.linear.weight,
        None,
        norm.running_mean,
        norm.running_var,
        norm.eps,
        norm.weight,
        norm.bias,
    )
    place, intensity, from_mean, from_centre = weight.detach().T.split([3, 1, 3, 3])
    point = torch.cat([place + from_mean + from_centre, intensity])
    terms = (point, place, -from_mean, bias.detach())
    return _Weights(*(term.contiguous().numpy() for term in terms))


@njit(cache=True, error_model="numpy")
def _fill(points, cells, centres, limits, weights, padding, pixels):
    """Write the features of all pillars of a frame into `pixels`, shape (ny * nx, C).

    `centres` are x of every column of pillars, y of every row, and z.
    """
    max_points, max_pillars = limits
    columns, rows, height = centres
    channels = pixels.shape[1]
    counts = np.zeros(len(pixels), np.int32)
    sums = np.zeros((len(pixels), 3), points.dtype)
    pillars = np.empty(min(len(points), len(pixels)), np.int32)
    found = 0
    for i in range(len(points)):
        cell = cells[i]
        if cell < 0 or counts[cell] >= max_points:
            continue
        pixel = pixels[cell]
        if counts[cell] == 0:
            if found == max_pillars:
                continue
            pillars[found] = cell
            found += 1
            pixel[:] = -np.inf
        counts[cell] += 1
        row = cell // len(columns)
        x, y = points[i, 0] - columns[cell - row * len(columns)], points[i, 1] - rows[row]
        z, light = points[i, 2] - height, points[i, 3]
        sums[cell, 0] += x
        sums[cell, 1] += y
        sums[cell, 2] += z
        for c in range(channels):
            value = weights.point[0, c] * x + weights.point[1, c] * y
            value += weights.point[2, c] * z + weights.point[3, c] * light
            pixel[c] = value if value > pixel[c] else pixel[c]
    for cell in pillars[:found]:
        pixel = pixels[cell]
        centre_x, centre_y = columns[cell % len(columns)], rows[cell // len(columns)]
        x, y, z = sums[cell] / np.float32(counts[cell])
        full = counts[cell] == max_points
        for c in range(channels):
            value = pixel[c] + weights.bias[c]
            value += weights.centre[0, c] * centre_x + weights.centre[1, c] * centre_y
            value += weights.centre[2, c] * height + weights.mean[0, c] * x
            value += weights.mean[1, c] * y + weights.mean[2, c] * z
            value = padding[c] if padding[c] > value and not full else value
            pixel[c] = 0.0 if value < 0.0 else value

"""The image of pillars in one pass over the points, on a CPU.

What `group`, `PillarEncoder` and `scatter` do, without a row for every point. A point's features
are linear in ten terms: its offset from the pillar's centre (3), its intensity, and what all points
of the pillar share: its centre (3), and the offset of their mean from there (3). Batch norm keeps
or turns round the order of the values of a channel. So the maximum over the pillar is that of four
products a point and channel, the rest is added once, and statistics of a batch follow from the sums
of the terms and of their products. Points stay unsorted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.detectors.backbones.pillars import PillarEncoder, PillarFeatureLayer
from training.detectors.layers import PaddedBatchNorm


def pillar_image(frames: Sequence[Tensor], encoder: PillarEncoder) -> Tensor:
    """Encode frames of points (N, 4) as an image (frames, C, ny, nx), channels last in memory.

    It is that of `scatter`, up to rounding. Gradients flow to the encoder's weights, not to the
    points."""
    layer = cast(PillarFeatureLayer, encoder.pfn_layers[0])
    parameters = (layer.linear.weight, layer.norm.weight, layer.norm.bias)
    learns = layer.norm.training or torch.is_grad_enabled()
    image: Tensor = _Image.apply(*parameters, frames, encoder, learns)
    nx, ny = encoder.grid.shape
    return image.view(len(frames), ny, nx, -1).permute(0, 3, 1, 2)


class _Image(torch.autograd.Function):
    """Linear layer, batch norm, ReLU and maximum, with the gradient in closed form.

    g: the gradient at the output of batch norm, of the points that are a maximum alone; u: the ten
    terms of a point; V: their weights; x: normalised values. Then
    dL/dV = γ/σ (Σ g u - mean(g) Σ u - mean(g x) Σ x u), and Σ x u = (V Σ u uᵀ - μ Σ u)/σ."""

    @staticmethod
    def forward(
        ctx: Any,
        weight: Tensor,
        gamma: Tensor,
        beta: Tensor,
        frames: Sequence[Tensor],
        encoder: PillarEncoder,
        learns: bool,
    ) -> Tensor:
        """Features of all cells of the frames, (frames * ny * nx, C), zero without a pillar.

        `learns`: there will be a backward pass, or statistics are of the batch."""
        grid, norm = encoder.grid, cast(PillarFeatureLayer, encoder.pfn_layers[0]).norm
        points = np.concatenate([np.zeros((0, 4), np.float32), *(f.cpu().numpy() for f in frames)])
        ends = np.cumsum([len(frame) for frame in frames])
        moving, shared = _weights_of_terms(weight.detach().numpy())
        dtype = moving.dtype
        sign = np.where(gamma.detach().numpy() < 0, -1, 1).astype(dtype)
        x, y, z = grid.axes
        products = np.zeros((4, 4) if learns else (0, 0))
        signed = np.ascontiguousarray((sign[:, None] * moving).T)
        of_points, centre, limits = grid.cells(points), grid.axes, grid.limits(norm.training)
        pillars = _collect(points, of_points, ends, centre, limits, signed, products)
        cells, counts, sums, best, winner = pillars
        column, row = cells % len(x), cells // len(x) % len(y)
        centres = np.stack([x[column], y[row], np.full(len(row), z)], axis=1)
        rest = np.hstack([centres, sums[:, :3] / counts[:, None]])
        common = rest.astype(dtype) @ shared.T
        rows = int(counts.sum())
        if grid.max_points:  # upstream fills a pillar up with rows of zeros
            rows = len(cells) * grid.max_points
        if learns:
            total = np.hstack([sums.sum(axis=0), counts @ rest])
            by_rest, of_rest = sums.T @ rest, rest.T @ (counts[:, None] * rest)
            squares = np.block([[products, by_rest], [by_rest.T, of_rest]])
            terms = np.hstack([moving, shared]).astype(np.float64)
        batch = norm.training and rows > 1  # one row has no variance
        if batch:
            mean, variance = _follow_batch(norm, terms, total, squares, rows)
        else:
            running = (norm.running_mean, norm.running_var)
            mean, variance = (cast(Tensor, item).numpy() for item in running)
        scale = 1 / np.sqrt(variance + norm.eps)
        image = np.zeros((len(ends) * len(x) * len(y), len(sign)), dtype)
        learnt = gamma.detach().numpy(), beta.detach().numpy()
        affine = (mean.astype(dtype), scale.astype(dtype), *learnt)
        padded = counts < grid.max_points if grid.max_points else np.zeros(len(cells), np.bool_)
        _normalise(best, winner, common, sign, padded, affine, cells, image)
        if learns:
            ctx.of_pillars = points, winner, centres, rest, best, cells
            ctx.sums = terms, total, squares, mean, scale, rows if batch else math.inf
            ctx.save_for_backward(gamma, beta)
        return torch.from_numpy(image)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients of weight, gamma and beta."""
        terms, total, squares, mean, scale, rows = ctx.sums
        gamma, beta = ctx.saved_tensors
        weights = gamma.detach().numpy(), beta.detach().numpy()
        of_cells = np.ascontiguousarray(gradient.numpy())
        of_terms, of_gamma, of_beta = _gradients(ctx.of_pillars, of_cells, *weights)
        by_normal = (terms @ squares - np.outer(mean, total)) * scale[:, None]
        of_terms -= np.outer(of_beta, total) / rows + of_gamma[:, None] * by_normal / rows
        of_terms *= (gamma.detach().numpy() * scale)[:, None]
        place, intensity, centre, mean_offset = np.split(of_terms, (3, 4, 7), axis=1)
        of_weight = np.hstack([place + centre, intensity, place - mean_offset, place])
        gradients = (of_weight, of_gamma, of_beta)
        return (*(torch.from_numpy(item).to(gamma.dtype) for item in gradients), None, None, None)


def _weights_of_terms(
    weight: NDArray[np.floating],
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Weights of the four terms of a point and of the six that its pillar shares, from (C, 10)."""
    place, intensity, from_mean, from_centre = np.split(weight, (3, 4, 7), axis=1)
    return np.hstack([place + from_mean + from_centre, intensity]), np.hstack([place, -from_mean])


def _follow_batch(
    norm: PaddedBatchNorm,
    weights: NDArray[np.float64],
    total: NDArray[np.float64],
    squares: NDArray[np.float64],
    rows: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and variance (C,) of a batch of `rows`, towards which running statistics move.

    `weights` (C, 10) are of the terms, `total` (10,) and `squares` (10, 10) the sums of the terms
    and of their products."""
    mean = weights @ total / rows
    spread = squares / rows - np.outer(total, total) / rows**2
    variance = np.maximum(((weights @ spread) * weights).sum(axis=1), 0)
    norm.follow(torch.from_numpy(mean), torch.from_numpy(variance), rows)
    return mean, variance


@njit(cache=True, error_model="numpy")
def _collect(points, cells, ends, centres, limits, weights, products):
    """Collect pillars; add the products of the four terms to `products`, or learn nothing.

    `points` (N, 4) are of frame after frame, which stop at `ends`, `cells` (N,) those in a frame,
    `centres` x of every column of pillars, y of every row, and z, `weights` (4, C) of the terms.

    Returns their cells as of `PillarBatch`, and numbers of points, (P,); the sums of the offset
    from the centre and of intensity over their points, (P, 4); the largest sum of the four
    products, (P, C), and the row of its point, which is anything where nothing is learnt."""
    (columns, rows, height), (max_points, max_pillars) = centres, limits
    channels = weights.shape[1]
    most = min(len(points), len(ends) * min(max_pillars, len(columns) * len(rows)))
    table = np.empty(len(columns) * len(rows), np.int32)
    # A row is set when its pillar is met: most rows never are, and their memory is never touched.
    cell_of, counts = np.empty(most, np.int64), np.empty(most, np.int64)
    sums, best = np.empty((most, 4)), np.empty((most, channels), weights.dtype)
    winner = np.empty((most, channels), np.int32)
    pillars = start = 0
    for frame in range(len(ends)):
        table[:] = -1
        first = pillars
        for n in range(start, ends[frame]):
            cell = cells[n]
            if cell < 0:
                continue
            p = table[cell]
            if p < 0:
                if pillars - first == max_pillars:
                    continue
                p = table[cell] = pillars
                cell_of[p], counts[p] = cell + frame * len(table), 0
                sums[p], best[p] = 0.0, -np.inf
                pillars += 1
            if counts[p] == max_points:
                continue
            counts[p] += 1
            row = cell // len(columns)
            x, y = points[n, 0] - columns[cell - row * len(columns)], points[n, 1] - rows[row]
            z, light = points[n, 2] - height, points[n, 3]
            u = (np.float64(x), np.float64(y), np.float64(z), np.float64(light))
            for i in range(4):
                sums[p, i] += u[i]
            if not len(products):
                for c in range(channels):
                    value = weights[0, c] * x + weights[1, c] * y
                    value += weights[2, c] * z + weights[3, c] * light
                    best[p, c] = value if value > best[p, c] else best[p, c]
                continue
            for c in range(channels):
                value = weights[0, c] * x + weights[1, c] * y
                value += weights[2, c] * z + weights[3, c] * light
                better = value > best[p, c]
                best[p, c] = value if better else best[p, c]
                winner[p, c] = n if better else winner[p, c]
            for i in range(4):
                for j in range(4):
                    products[i, j] += u[i] * u[j]
        start = ends[frame]
    return cell_of[:pillars], counts[:pillars], sums[:pillars], best[:pillars], winner[:pillars]


@njit(cache=True)
def _normalise(best, winner, common, sign, padded, affine, cells, image):
    """Fill the cells of `image`; `best` (P, C) become the normalised values.

    `common` (P, C) is the part of the value that all points of a pillar share, `affine` are mean,
    scale, gamma and beta of batch norm. In pillars that are `padded` a row of zeros takes part,
    which is row -1 among the winners."""
    mean, scale, gamma, beta = affine
    zero = best.dtype.type(0)
    for p in range(len(best)):
        for c in range(best.shape[1]):
            value = best[p, c] * sign[c] + common[p, c]
            if padded[p] and sign[c] * value < zero:
                value, winner[p, c] = zero, -1
            best[p, c] = (value - mean[c]) * scale[c]
            image[cells[p], c] = max(best[p, c] * gamma[c] + beta[c], zero)


@njit(cache=True)
def _gradients(pillars, gradient, gamma, beta):
    """Sums over the pillars of the gradients g at the output of batch norm, float64.

    Of the ten terms times g (C, 10), of normalised values times g (C,), and of g (C,)."""
    points, winner, centres, rest, normal, cells = pillars
    channels = len(gamma)
    of_terms, of_gamma, of_beta = np.zeros((channels, 10)), np.zeros(channels), np.zeros(channels)
    for p in range(len(cells)):
        for c in range(channels):
            g = np.float64(gradient[cells[p], c])
            if g == 0 or not normal[p, c] * gamma[c] + beta[c] > 0:
                continue
            of_gamma[c] += g * normal[p, c]
            of_beta[c] += g
            n = winner[p, c]
            if n < 0:
                continue
            for axis in range(3):
                of_terms[c, axis] += g * (points[n, axis] - centres[p, axis])
            of_terms[c, 3] += g * points[n, 3]
            for term in range(6):
                of_terms[c, 4 + term] += g * rest[p, term]
    return of_terms, of_gamma, of_beta

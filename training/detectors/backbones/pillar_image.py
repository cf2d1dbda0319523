"""The image of pillars in one pass over the points, on a CPU.

What `group`, `PillarEncoder` and `scatter` do, without a row for every point. A point's features
are linear in ten terms: its offset from the pillar's centre (3), its intensity, and what all points
of the pillar share: its centre (3), and the offset of their mean from there (3). Batch norm keeps
or turns round the order of the values of a channel. So the maximum over the pillar is that of four
products a point and channel, the rest is added once, and statistics of a batch follow from the sums
of the terms and of their products. Points stay unsorted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.detectors.backbones.pillars import (
    PillarEncoder,
    PillarFeatureLayer,
    PillarGrid,
    scatter,
)
from training.detectors.layers import PaddedBatchNorm


def pillar_image(frames: Sequence[Tensor], encoder: PillarEncoder) -> Tensor:
    """Pillars of frames of points (N, 4) as an image (frames, C, ny, nx), channels last in memory.

    That of `scatter`, up to rounding. Gradients flow to the encoder's weights, not to the points.
    """
    layer = cast(PillarFeatureLayer, encoder.pfn_layers[0])
    norm, grid = layer.norm, encoder.grid
    points = np.concatenate([np.zeros((0, 4), np.float32), *(f.cpu().numpy() for f in frames)])
    ends = np.cumsum([len(frame) for frame in frames])
    parameters = (layer.linear.weight, norm.weight, norm.bias)
    learns = norm.training or torch.is_grad_enabled()
    features, cells = _Features.apply(*parameters, points, ends, grid, norm, learns)
    return scatter(features, cells, len(frames), grid)


class _Features(torch.autograd.Function):
    """Linear layer, batch norm, ReLU and maximum, with the gradient in closed form.

    g: the gradient at the output of batch norm, of the points that are a maximum alone; u: the ten
    terms of a point; V: their weights; x: normalised values. Then
    dL/dV = γ/σ (Σ g u - mean(g) Σ u - mean(g x) Σ x u), and Σ x u = (V Σ u uᵀ - μ Σ u)/σ.
    """

    @staticmethod
    def forward(
        ctx: Any,
        weight: Tensor,
        gamma: Tensor,
        beta: Tensor,
        points: NDArray[np.float32],
        ends: NDArray[np.int64],
        grid: PillarGrid,
        norm: PaddedBatchNorm,
        learns: bool,
    ) -> tuple[Tensor, Tensor]:
        """Features (P, C) of the pillars, and their cells (P,).

        `learns`: there will be a backward pass, or statistics are of the batch.
        """
        own = weight.detach().numpy()
        from_mean, from_centre = own[:, 4:7], own[:, 7:]
        moving = np.hstack([own[:, :3] + from_mean + from_centre, own[:, 3:4]])
        shared = np.hstack([own[:, :3], -from_mean])
        sign = np.where(gamma.detach().numpy() < 0, -1, 1).astype(own.dtype)
        x, _, z = grid.centres(torch.arange(grid.shape[0])).T.numpy()
        _, y, _ = grid.centres(grid.shape[0] * torch.arange(grid.shape[1])).T.numpy()
        products = np.zeros((4, 4) if learns else (0, 0))
        signed = np.ascontiguousarray((sign[:, None] * moving).T)
        of_points, centre, limits = grid.cells(points), (x, y, z[0]), grid.limits(norm.training)
        pillars = _collect(points, of_points, ends, centre, limits, signed, products)
        cells, counts, sums, raw, winner = pillars
        column, row = cells % len(x), cells // len(x) % len(y)
        centres = np.stack([x[column], y[row], np.full(len(row), z[0])], axis=1)
        rest = np.hstack([centres, sums[:, :3] / counts[:, None]])
        raw *= sign  # from here on in place: these are the large arrays
        raw += rest.astype(own.dtype) @ shared.T
        rows = int(counts.sum())
        if grid.max_points:  # upstream fills a pillar up with rows of zeros
            rows = len(raw) * grid.max_points
            zero = (counts < grid.max_points)[:, None] & (sign * raw < 0)
            raw[zero], winner[zero] = 0, -1
        if learns:
            total = np.hstack([sums.sum(axis=0), counts @ rest])
            by_rest, of_rest = sums.T @ rest, rest.T @ (counts[:, None] * rest)
            squares = np.block([[products, by_rest], [by_rest.T, of_rest]])
            terms = np.hstack([moving, shared]).astype(np.float64)
        batch = norm.training and rows > 1  # one row has no variance
        if batch:
            mean = terms @ total / rows
            spread = squares / rows - np.outer(total, total) / rows**2
            variance = np.maximum(np.einsum("ci,ij,cj->c", terms, spread, terms), 0)
            norm.follow(torch.from_numpy(mean), torch.from_numpy(variance), rows)
        else:
            running = (norm.running_mean, norm.running_var)
            mean, variance = (cast(Tensor, item).numpy() for item in running)
        scale = 1 / np.sqrt(variance + norm.eps)
        raw -= mean.astype(own.dtype)
        raw *= scale.astype(own.dtype)
        out = np.multiply(raw, gamma.detach().numpy(), out=None if learns else raw)
        out += beta.detach().numpy()
        np.maximum(out, 0, out=out)
        if learns:
            ctx.kept = points, winner, centres, rest, raw, out
            ctx.sums = terms, total, squares, mean, scale, rows if batch else math.inf
            ctx.save_for_backward(gamma)
        found = torch.from_numpy(cells)
        ctx.mark_non_differentiable(found)
        return torch.from_numpy(out), found

    @staticmethod
    def backward(ctx: Any, gradient: Tensor, _: Any) -> tuple[Tensor | None, ...]:
        """Gradients of weight, gamma and beta."""
        points, winner, centres, rest, normal, out = ctx.kept
        terms, total, squares, mean, scale, rows = ctx.sums
        (gamma,) = ctx.saved_tensors
        g = np.where(out > 0, gradient.numpy(), 0)
        of_points = np.where(winner >= 0, g, 0)
        moving = _sum_winners(points, centres, winner, of_points)
        found = np.hstack([moving, of_points.T @ rest])
        of_gamma, of_beta = np.einsum("pc,pc->c", g, normal), g.sum(axis=0)
        by_normal = (terms @ squares - np.outer(mean, total)) * scale[:, None]
        found -= np.outer(of_beta, total) / rows + of_gamma[:, None] * by_normal / rows
        found *= (gamma.detach().numpy() * scale)[:, None]
        place = found[:, :3]
        of_weight = np.hstack([place + found[:, 4:7], found[:, 3:4], place - found[:, 7:], place])
        kind = gamma.dtype
        of_all = (torch.from_numpy(item).to(kind) for item in (of_weight, of_gamma, of_beta))
        return (*of_all, None, None, None, None, None)


@njit(cache=True, error_model="numpy")
def _collect(points, cells, ends, centres, limits, weights, products):
    """Pillars; adds the products of the four terms of all points to `products`, or learns nothing.

    `points` (N, 4) are of frame after frame, which stop at `ends`, `cells` (N,) those in a frame,
    `centres` x of every column of pillars, y of every row, and z, `weights` (4, C) of the terms.

    Returns their cells as of `PillarBatch`, and numbers of points, (P,); the sums of the offset
    from the centre and of intensity over their points, (P, 4); the largest sum of the four
    products, (P, C), and the row of its point, which is anything where nothing is learnt.
    """
    columns, rows, height = centres
    max_points, max_pillars = limits
    channels = weights.shape[1]
    most = min(len(points), len(ends) * min(max_pillars, len(columns) * len(rows)))
    table = np.empty(len(columns) * len(rows), np.int32)
    # A row is set when its pillar is met: most rows never are, and their memory is never touched.
    found_cells, counts = np.empty(most, np.int64), np.empty(most, np.int64)
    sums, best = np.empty((most, 4)), np.empty((most, channels), weights.dtype)
    winner = np.empty((most, channels), np.int32)
    found = start = 0
    for frame in range(len(ends)):
        table[:] = -1
        first = found
        for n in range(start, ends[frame]):
            cell = cells[n]
            if cell < 0:
                continue
            p = table[cell]
            if p < 0:
                if found - first == max_pillars:
                    continue
                p = table[cell] = found
                found_cells[p], counts[p] = cell + frame * len(table), 0
                for i in range(4):
                    sums[p, i] = 0.0
                for c in range(channels):
                    best[p, c] = -np.inf
                found += 1
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
    return found_cells[:found], counts[:found], sums[:found], best[:found], winner[:found]


@njit(cache=True)
def _sum_winners(points, centres, winner, gradient):
    """Sum of the four terms of the winners times their gradients, shape (C, 4), float64."""
    total = np.zeros((winner.shape[1], 4))
    for p in range(len(winner)):
        for c in range(winner.shape[1]):
            g = gradient[p, c]
            if g != 0:
                n = winner[p, c]
                for axis in range(3):
                    total[c, axis] += g * (points[n, axis] - centres[p, axis])
                total[c, 3] += g * points[n, 3]
    return total

"""Features between points, from the three nearest."""

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.ops.grouping import chunks, group


def three_nn(
    unknown: Tensor, unknown_counts: Tensor, known: Tensor, known_counts: Tensor
) -> tuple[Tensor, Tensor]:
    """The three nearest known points of the same frame, nearest first.

    Points (M, 3) and (N, 3) are finite, frame after frame, so many (B,) of each. Returns distances,
    (M, 3), metres, and rows of `known`, (M, 3) int64. A frame with fewer than three known points
    fills up with distance infinity and row 0.
    """
    search = _nearest_numba if unknown.is_cpu else _nearest_torch
    distances = torch.full_like(unknown.detach(), torch.inf)
    idx = torch.zeros(unknown.shape, dtype=torch.int64, device=unknown.device)
    start = known_start = 0
    for count, known_count in zip(unknown_counts.tolist(), known_counts.tolist(), strict=True):
        if count and known_count:
            own = slice(start, start + count)
            near = min(3, known_count)
            distances[own, :near], found = search(
                unknown.detach()[own], known.detach()[known_start : known_start + known_count], near
            )
            idx[own, :near] = known_start + found
        start, known_start = start + count, known_start + known_count
    return distances, idx


@njit(cache=True)
def _nearest_kernel(unknown, known, axis, order, along, places, distances, idx):
    """Search outwards along `axis`, in which `order` sorts `known`, until it alone is too far; from
    the `places` of `unknown` among `along`, the sorted coordinates.

    Of equally near points the lowest rows count, as upstream.
    """
    near = distances.shape[1]
    distances[:] = np.inf
    for m in range(len(unknown)):
        x, y, z = unknown[m, 0], unknown[m, 1], unknown[m, 2]
        above = places[m]
        below = above - 1
        while below >= 0 or above < len(order):
            down = unknown[m, axis] - along[below] if below >= 0 else np.inf
            up = along[above] - unknown[m, axis] if above < len(order) else np.inf
            gap = distances.dtype.type(min(down, up))
            if gap * gap > distances[m, near - 1]:
                break
            if down < up:
                i = order[below]
                below -= 1
            else:
                i = order[above]
                above += 1
            dx, dy, dz = x - known[i, 0], y - known[i, 1], z - known[i, 2]
            squared = dx * dx + dy * dy + dz * dz
            k = near
            while k > 0 and (
                squared < distances[m, k - 1]
                or (squared == distances[m, k - 1] and i < idx[m, k - 1])
            ):
                if k < near:
                    distances[m, k], idx[m, k] = distances[m, k - 1], idx[m, k - 1]
                k -= 1
            if k < near:
                distances[m, k], idx[m, k] = squared, i


def _nearest_numba(unknown: Tensor, known: Tensor, near: int) -> tuple[Tensor, Tensor]:
    points, wanted = known.contiguous().numpy(), unknown.contiguous().numpy()
    axis = int(np.argmax(np.ptp(points, axis=0)))
    distances = np.empty((len(unknown), near), points.dtype)
    idx = np.zeros(distances.shape, np.int64)
    order = np.argsort(points[:, axis])
    along = points[order, axis]
    places = np.searchsorted(along, wanted[:, axis])
    _nearest_kernel(wanted, points, axis, order, along, places, distances, idx)
    return torch.from_numpy(np.sqrt(distances)), torch.from_numpy(idx)


def _nearest_torch(unknown: Tensor, known: Tensor, near: int) -> tuple[Tensor, Tensor]:
    distances = unknown.new_empty(len(unknown), near)
    idx = torch.empty(len(unknown), near, dtype=torch.int64, device=unknown.device)
    for own in chunks(len(unknown), len(known)):
        dx, dy, dz = (unknown[own, axis, None] - known[:, axis] for axis in range(3))
        squared, idx[own] = (dx * dx + dy * dy + dz * dz).topk(near, dim=1, largest=False)
        distances[own] = squared.sqrt()
    return distances, idx


def inverse_distance_weights(distances: Tensor) -> Tensor:
    """Weights (M, 3) of `three_nn`'s points, 1 / distance and 1 in sum; 0 if there is no point.

    PointNet++ (Qi et al., NeurIPS 2017), equation (2) with p = 1.
    """
    inverse = 1 / (distances + 1e-8)
    return inverse / inverse.sum(dim=1, keepdim=True).clamp_min(torch.finfo(inverse.dtype).tiny)


def interpolate(features: Tensor, idx: Tensor, weights: Tensor) -> Tensor:
    """Sums (M, C) of rows `idx` (M, K) of `features` (N, C), weighted with `weights` (M, K)."""
    return (group(features, idx) * weights[..., None]).sum(dim=1)

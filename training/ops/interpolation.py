"""Features between points, from the three nearest."""

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.ops.grouping import chunks, group


def three_nn(
    points: Tensor, counts: Tensor, places: Tensor, place_counts: Tensor
) -> tuple[Tensor, Tensor]:
    """Find the three nearest places of its frame for each point, nearest first.

    Points (M, 3) and places (N, 3) are finite, frame after frame, `counts` and `place_counts` (B,)
    of them. Returns distances, (M, 3), metres, and rows of `places`, (M, 3) int64. A frame with
    fewer than three places fills up with distance infinity and row 0."""
    search = _nearest_numba if points.is_cpu else _nearest_torch
    distances = torch.full_like(points.detach(), torch.inf)
    idx = torch.zeros(points.shape, dtype=torch.int64, device=points.device)
    start = place_start = 0
    for count, place_count in zip(counts.tolist(), place_counts.tolist(), strict=True):
        frame = slice(start, start + count)
        frame_places = slice(place_start, place_start + place_count)
        if count and place_count:
            near = min(3, place_count)
            distances[frame, :near], rows = search(
                points.detach()[frame], places.detach()[frame_places], near
            )
            idx[frame, :near] = place_start + rows
        start, place_start = frame.stop, frame_places.stop
    return distances, idx


@njit(cache=True)
def _nearest_kernel(points, places, axis, order, starts, distances, idx):
    """Search outwards along `axis`, in which `order` sorts `places`, until it alone is too far.

    The search for a point begins at its place `starts` in that order. Of equally near places the
    lowest rows count, as upstream."""
    near, along = distances.shape[1], places[:, axis][order]
    distances[:] = np.inf
    for m in range(len(points)):
        x, y, z = points[m, 0], points[m, 1], points[m, 2]
        upper = starts[m]
        lower = upper - 1
        while lower >= 0 or upper < len(order):
            down = points[m, axis] - along[lower] if lower >= 0 else np.inf
            up = along[upper] - points[m, axis] if upper < len(order) else np.inf
            gap = distances.dtype.type(min(down, up))
            if gap * gap > distances[m, near - 1]:
                break
            if down < up:
                i = order[lower]
                lower -= 1
            else:
                i = order[upper]
                upper += 1
            dx, dy, dz = x - places[i, 0], y - places[i, 1], z - places[i, 2]
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


def _nearest_numba(points: Tensor, places: Tensor, near: int) -> tuple[Tensor, Tensor]:
    xyz, place_xyz = points.contiguous().numpy(), places.contiguous().numpy()
    axis = int(np.argmax(np.ptp(place_xyz, axis=0)))
    distances = np.empty((len(xyz), near), place_xyz.dtype)
    idx = np.zeros(distances.shape, np.int64)
    order = np.argsort(place_xyz[:, axis])
    starts = np.searchsorted(place_xyz[order, axis], xyz[:, axis])
    _nearest_kernel(xyz, place_xyz, axis, order, starts, distances, idx)
    return torch.from_numpy(np.sqrt(distances)), torch.from_numpy(idx)


def _nearest_torch(points: Tensor, places: Tensor, near: int) -> tuple[Tensor, Tensor]:
    distances = points.new_empty(len(points), near)
    idx = torch.empty(len(points), near, dtype=torch.int64, device=points.device)
    for part in chunks(len(points), len(places)):
        dx, dy, dz = (points[part, axis, None] - places[:, axis] for axis in range(3))
        squared, idx[part] = (dx * dx + dy * dy + dz * dz).topk(near, dim=1, largest=False)
        distances[part] = squared.sqrt()
    return distances, idx


def inverse_distance_weights(distances: Tensor) -> Tensor:
    """Weights (M, 3) of `three_nn`'s places, 1 / distance and 1 in sum; 0 without places.

    PointNet++ (Qi et al., NeurIPS 2017), equation (2) with p = 1."""
    inverse = 1 / (distances + 1e-8)
    return inverse / inverse.sum(dim=1, keepdim=True).clamp_min(torch.finfo(inverse.dtype).tiny)


def interpolate(features: Tensor, idx: Tensor, weights: Tensor) -> Tensor:
    """Sum rows `idx` (M, K) of `features` (N, C) with `weights` (M, K), shape (M, C)."""
    return (group(features, idx) * weights[..., None]).sum(dim=1)

"""Features between points, from the three nearest."""

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.ops.grouping import group


def three_nn(
    points: Tensor, counts: Tensor, places: Tensor, place_counts: Tensor
) -> tuple[Tensor, Tensor]:
    """Find the three nearest places of its frame for each point, nearest first.

    Points (M, 3) and places (N, 3) are finite, frame after frame, `counts` and `place_counts` (B,)
    of them. Returns distances, (M, 3), metres, and rows of `places`, (M, 3) int64. A frame with
    fewer than three places fills up with distance infinity and row 0."""
    search = _nearest_numba if points.is_cpu else _nearest_triton
    return search(points.detach(), counts, places.detach(), place_counts)


@njit(cache=True)
def _nearest_kernel(points, places, axis, order, starts, distances, idx):
    """Search outwards along `axis`, in which `order` sorts `places`, until it alone is too far.

    The search for a point begins at its place `starts` in that order. Of equally near places the
    lowest rows count, as upstream. `distances` are squared, and infinite before."""
    near, along = min(3, len(places)), places[:, axis][order]
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


def _nearest_numba(points, counts, places, place_counts) -> tuple[Tensor, Tensor]:
    xyz, place_xyz = points.contiguous().numpy(), places.contiguous().numpy()
    distances, idx = np.full_like(xyz, np.inf), np.zeros(xyz.shape, np.int64)
    start = place_start = 0
    for count, place_count in zip(counts.tolist(), place_counts.tolist(), strict=True):
        frame, near = slice(start, start + count), min(3, place_count)
        frame_places = place_xyz[place_start : place_start + place_count]
        if count and place_count:
            axis = int(np.argmax(np.ptp(frame_places, axis=0)))
            order = np.argsort(frame_places[:, axis])
            starts = np.searchsorted(frame_places[order, axis], xyz[frame, axis])
            nearest = distances[frame], idx[frame]
            _nearest_kernel(xyz[frame], frame_places, axis, order, starts, *nearest)
            idx[frame, :near] += place_start
        start, place_start = start + count, place_start + place_count
    return torch.from_numpy(np.sqrt(distances)), torch.from_numpy(idx)


def _nearest_triton(points, counts, places, place_counts) -> tuple[Tensor, Tensor]:
    from training.ops.gpu.neighbours import three_nearest

    squared, idx = three_nearest(points, counts, places, place_counts)
    return squared.sqrt_(), idx


def inverse_distance_weights(distances: Tensor) -> Tensor:
    """Weights (M, 3) of `three_nn`'s places, 1 / distance and 1 in sum; 0 without places.

    PointNet++ (Qi et al., NeurIPS 2017), equation (2) with p = 1."""
    inverse = 1 / (distances + 1e-8)
    return inverse / inverse.sum(dim=1, keepdim=True).clamp_min(torch.finfo(inverse.dtype).tiny)


def interpolate(features: Tensor, idx: Tensor, weights: Tensor) -> Tensor:
    """Sum rows `idx` (M, K) of `features` (N, C) with `weights` (M, K), shape (M, C)."""
    return (group(features, idx) * weights[..., None]).sum(dim=1)

"""Which box a point lies in."""

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.ops.rotation import cos_sin

MARGIN = 1e-5
"""A point so far outside the sides of a box, metres, is inside: OpenPCDet's kernel."""
_CHUNK = 1 << 24
"""Pairs that the torch path holds at once."""


def box_of_points(points: Tensor, boxes: Tensor) -> Tensor:
    """The first of the boxes (M, 7) that each point (N, 3) lies in, -1 if none, (N,) int64."""
    search = _first_box_numba if points.is_cpu else _first_box_torch
    return search(points.detach(), boxes.detach().to(points))


@njit(cache=True)
def _first_box_kernel(points, boxes, cosine, sine, margin, out):
    count = len(boxes)
    reach = np.empty_like(boxes[:, 0])
    half = boxes[:, 3:6] / boxes.dtype.type(2)
    for k in range(count):
        # Rounded up: the exact test follows.
        reach[k] = boxes.dtype.type(1.001) * (half[k, 0] + half[k, 1] + margin)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        out[i] = -1
        for k in range(count):
            dx, dy = x - boxes[k, 0], y - boxes[k, 1]
            if abs(dx) > reach[k] or abs(dy) > reach[k] or abs(z - boxes[k, 2]) > half[k, 2]:
                continue
            u = dx * cosine[k] + dy * sine[k]
            v = dy * cosine[k] - dx * sine[k]
            if abs(u) < half[k, 0] + margin and abs(v) < half[k, 1] + margin:
                out[i] = k
                break


def _first_box_numba(points: Tensor, boxes: Tensor) -> Tensor:
    xyz = points.contiguous().numpy()
    out = np.empty(len(xyz), np.int64)
    cosine, sine = (part.numpy() for part in cos_sin(boxes[:, 6]))
    _first_box_kernel(xyz, boxes.contiguous().numpy(), cosine, sine, xyz.dtype.type(MARGIN), out)
    return torch.from_numpy(out)


def _first_box_torch(points: Tensor, boxes: Tensor) -> Tensor:
    out = torch.full((len(points),), -1, dtype=torch.int64, device=points.device)
    if len(boxes) == 0:
        return out
    step = max(1, _CHUNK // len(boxes))
    for low in range(0, len(points), step):
        inside = inside_boxes(points[low : low + step], boxes).t()
        out[low : low + step] = torch.where(inside.any(dim=1), inside.int().argmax(dim=1), -1)
    return out


def inside_boxes(points: Tensor, boxes: Tensor) -> Tensor:
    """Which points (N, 3) lie in which boxes (M, 7), (M, N) bool."""
    x, y, z, length, width, height, yaw = boxes[:, :, None].unbind(dim=1)
    dx, dy, dz = points[:, 0] - x, points[:, 1] - y, points[:, 2] - z
    cosine, sine = cos_sin(yaw)
    u = dx * cosine + dy * sine
    v = dy * cosine - dx * sine
    return (
        (u.abs() < length / 2 + MARGIN) & (v.abs() < width / 2 + MARGIN) & (dz.abs() <= height / 2)
    )

"""RoI-point pooling: the points inside each box, as many for every box (PointRCNN, CVPR 2019)."""

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.ops.grouping import first_hits, group
from training.ops.points_in_boxes import MARGIN, cos_sin, inside_boxes

_CHUNK = 1 << 24  # pairs that the torch path holds at once


def roipoint_pool(
    points: Tensor, features: Tensor, boxes: Tensor, samples: int, extra: float
) -> tuple[Tensor, Tensor]:
    """The first S of the finite points (N, 3) of a frame, in their order, in each box (R, 7).

    A box with fewer repeats them in their order; `extra` metres are added to its sides before.

    Returns coordinates and features, (R, S, 3 + C), zeros where there is no point; and which boxes
    are empty, (R,) bool. Gradients flow to `features` (N, C).
    """
    large = boxes.detach().to(points).clone()
    large[:, 3:6] += extra
    search = _points_numba if points.is_cpu else _points_torch
    idx, empty = search(points.detach(), large, samples)
    pooled = torch.cat([group(points, idx), group(features, idx)], dim=2)
    return pooled.masked_fill(empty[:, None, None], 0), empty


@njit(cache=True)
def _points_kernel(points, boxes, cosines, sines, margin, idx, empty):
    for r in range(len(boxes)):
        x, y, z = boxes[r, 0], boxes[r, 1], boxes[r, 2]
        half = boxes[r, 3:6] / boxes.dtype.type(2)
        cosine, sine = cosines[r], sines[r]
        # Rounded up: the exact test follows.
        reach = boxes.dtype.type(1.001) * (half[0] + half[1] + margin)
        found = 0
        for i in range(len(points)):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            if abs(dx) > reach or abs(dy) > reach or abs(points[i, 2] - z) > half[2]:
                continue
            u = dx * cosine + dy * sine
            v = dy * cosine - dx * sine
            if abs(u) < half[0] + margin and abs(v) < half[1] + margin:
                idx[r, found] = i
                found += 1
                if found == idx.shape[1]:
                    break
        empty[r] = found == 0
        for k in range(found, idx.shape[1] if found else 0):
            idx[r, k] = idx[r, k - found]


def _points_numba(points: Tensor, boxes: Tensor, samples: int) -> tuple[Tensor, Tensor]:
    xyz = points.contiguous().numpy()
    idx = np.zeros((len(boxes), samples), np.int64)
    empty = np.empty(len(boxes), bool)
    cosines, sines = (part.numpy() for part in cos_sin(boxes[:, 6]))
    _points_kernel(xyz, boxes.numpy(), cosines, sines, xyz.dtype.type(MARGIN), idx, empty)
    return torch.from_numpy(idx), torch.from_numpy(empty)


def _points_torch(points: Tensor, boxes: Tensor, samples: int) -> tuple[Tensor, Tensor]:
    idx = torch.zeros(len(boxes), samples, dtype=torch.int64, device=points.device)
    found = torch.zeros(len(boxes), dtype=torch.int64, device=points.device)
    step = max(1, _CHUNK // max(1, len(points)))
    for low in range(0, len(boxes), step):
        own = slice(low, low + step)
        idx[own], found[own] = first_hits(inside_boxes(points, boxes[own]), samples)
    turn = torch.arange(samples, device=points.device) % found.clamp_min(1)[:, None]
    return idx.gather(1, turn), found == 0

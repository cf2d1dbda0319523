"""Search for the box in which a point lies."""

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import inner, njit
from training.ops.grouping import chunks

MARGIN = 1e-5  # a point so far outside the sides of a box, metres, is inside: OpenPCDet's kernel
_CELLS = 64  # cells along each side of the square around all boxes


def cos_sin(yaw: Tensor) -> tuple[Tensor, Tensor]:
    """Cosine and sine of angles, radians, in their shape and dtype. Gradients flow.

    Libraries of mathematical functions differ in the last bit, and so would points on the border of
    a box. Rounded from double precision, float32 values differ in one of 10⁸ cases."""
    wide = yaw.double()
    return torch.cos(wide).to(yaw.dtype), torch.sin(wide).to(yaw.dtype)


def box_of_points(points: Tensor, boxes: Tensor) -> Tensor:
    """Find the first of the boxes (M, 7) in which each point (N, 3 or more) lies, -1 if none."""
    search = _first_box_numba if points.is_cpu else _first_box_torch
    return search(points.detach(), boxes.detach().to(points))


@njit(cache=True, error_model="numpy")
def _first_box_kernel(points, boxes, cosine, sine, margin, out):
    count, dtype = len(boxes), boxes.dtype.type
    out[:] = -1
    if count == 0:
        return
    two, more, cells_a_side = dtype(2), dtype(1.001), dtype(_CELLS)
    half, (reach_x, reach_y) = np.empty((count, 3), dtype), np.empty((2, count), dtype)
    x, y = boxes[:, 0], boxes[:, 1]
    low_x = low_y = dtype(np.inf)
    high_x = high_y = dtype(-np.inf)
    for k in range(count):
        for axis in range(3):
            half[k, axis] = boxes[k, 3 + axis] / two
        # Rounded up: the exact test follows.
        along, aside, c, s = half[k, 0] + margin, half[k, 1] + margin, abs(cosine[k]), abs(sine[k])
        reach_x[k], reach_y[k] = more * (c * along + s * aside), more * (s * along + c * aside)
        low_x, high_x = min(low_x, x[k] - reach_x[k]), max(high_x, x[k] + reach_x[k])
        low_y, high_y = min(low_y, y[k] - reach_y[k]), max(high_y, y[k] + reach_y[k])
    by_x, by_y = cells_a_side / (high_x - low_x), cells_a_side / (high_y - low_y)
    # Most points are in a cell, seen from above, that no box comes near.
    cells = np.zeros((_CELLS, _CELLS), np.bool_)
    for k in range(count):
        x0, x1 = _cell(x[k] - reach_x[k], low_x, by_x), _cell(x[k] + reach_x[k], low_x, by_x)
        y0, y1 = _cell(y[k] - reach_y[k], low_y, by_y), _cell(y[k] + reach_y[k], low_y, by_y)
        cells[max(x0 - 1, 0) : x1 + 2, max(y0 - 1, 0) : y1 + 2] = True
    for i in range(len(points)):
        if not cells[_cell(points[i, 0], low_x, by_x), _cell(points[i, 1], low_y, by_y)]:
            continue
        for k in range(count):
            dx, dy, dz = points[i, 0] - x[k], points[i, 1] - y[k], points[i, 2] - boxes[k, 2]
            if abs(dx) > reach_x[k] or abs(dy) > reach_y[k] or abs(dz) > half[k, 2]:
                continue
            u = dx * cosine[k] + dy * sine[k]
            v = dy * cosine[k] - dx * sine[k]
            if abs(u) < half[k, 0] + margin and abs(v) < half[k, 1] + margin:
                out[i] = k
                break


@inner
def _cell(x, low, by) -> int:
    """Cell of a coordinate, or the nearest one; `by` is cells a metre."""
    cell = (x - low) * by
    if not cell > 0:  # of what is no number too
        return 0
    return int(cell) if cell < _CELLS - 1 else _CELLS - 1


def _first_box_numba(points: Tensor, boxes: Tensor) -> Tensor:
    xyz = points.contiguous().numpy()
    out = np.empty(len(xyz), np.int64)
    cosine, sine = (part.numpy() for part in cos_sin(boxes[:, 6]))
    _first_box_kernel(xyz, boxes.contiguous().numpy(), cosine, sine, xyz.dtype.type(MARGIN), out)
    return torch.from_numpy(out)


def _first_box_torch(points: Tensor, boxes: Tensor) -> Tensor:
    out = torch.full((len(points),), -1, dtype=torch.int64, device=points.device)
    for part in chunks(len(points), len(boxes)) if len(boxes) else ():
        inside = inside_boxes(points[part], boxes).t()
        out[part] = torch.where(inside.any(dim=1), inside.int().argmax(dim=1), -1)
    return out


def inside_boxes(points: Tensor, boxes: Tensor) -> Tensor:
    """Test if each of the points (N, 3) is in each of the boxes (M, 7), (M, N) bool."""
    x, y, z, length, width, height, yaw = boxes[:, :, None].unbind(dim=1)
    dx, dy, dz = points[:, 0] - x, points[:, 1] - y, points[:, 2] - z
    cosine, sine = cos_sin(yaw)
    along = (dx * cosine + dy * sine).abs() < length / 2 + MARGIN
    across = (dy * cosine - dx * sine).abs() < width / 2 + MARGIN
    return along & across & (dz.abs() <= height / 2)

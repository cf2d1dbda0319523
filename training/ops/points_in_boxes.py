"""Search for the box in which a point lies."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from lidarplace.base.kernel_cache import inner, njit
from training.ops.grouping import stacked_counts

MARGIN = 1e-5  # a point so far outside the sides of a box, metres, is inside: OpenPCDet's kernel
_CELLS = 64  # cells along each side of the square around all boxes


def cos_sin(yaw: Tensor) -> tuple[Tensor, Tensor]:
    """Cosine and sine of angles, radians, in their shape and dtype. Gradients flow.

    Libraries of mathematical functions differ in the last bit, and so would points on the border of
    a box. Rounded from double precision, float32 values differ in one of 10⁸ cases."""
    wide = yaw.double()
    return torch.cos(wide).to(yaw.dtype), torch.sin(wide).to(yaw.dtype)


def box_of_points(points: Tensor, counts: Sequence[int], boxes: Sequence[Tensor]) -> Tensor:
    """Find the first box of its frame in which each point (N, 3 or more) lies, -1 if none.

    Points are frame after frame, `counts` of them, `boxes` (M, 7) those of each frame. Returns
    rows of all boxes, frame after frame, (N,) int64."""
    search = _first_box_numba if points.is_cpu else _first_box_triton
    return search(points.detach(), counts, [frame.detach().to(points) for frame in boxes])


def points_of_boxes(
    points: Tensor, counts: Sequence[int], boxes: Tensor, samples: int
) -> tuple[Tensor, Tensor]:
    """Find the first S points of its frame, in their order, in each of the boxes (B, R, 7).

    Points (N, 3) are frame after frame, `counts` of them. Returns rows of `points`, (B * R, S)
    int64; they repeat in their order where there are fewer, all are 0 where there is none. And
    which boxes are empty, (B * R,) bool."""
    search = _first_points_numba if points.is_cpu else _first_points_triton
    return search(points.detach(), counts, boxes.detach().to(points), samples)


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
            if _is_within(dx, dy, half[k], margin, cosine[k], sine[k]):
                out[i] = k
                break


@njit(cache=True)
def _first_points_kernel(points, boxes, cosine, sine, margin, start, idx, empty):
    for k in range(len(boxes)):
        half, hits = boxes[k, 3:6] / boxes.dtype.type(2), 0
        for i in range(len(points)):
            dx, dy = points[i, 0] - boxes[k, 0], points[i, 1] - boxes[k, 1]
            if abs(points[i, 2] - boxes[k, 2]) > half[2]:
                continue
            if _is_within(dx, dy, half, margin, cosine[k], sine[k]):
                idx[k, hits] = start + i
                hits += 1
                if hits == idx.shape[1]:
                    break
        empty[k] = hits == 0
        for j in range(hits, idx.shape[1] if hits else 0):
            idx[k, j] = idx[k, j - hits]


@inner
def _is_within(dx, dy, half, margin, cosine, sine):
    """Test a point at (dx, dy) from the centre of a box against its sides."""
    along, across = dx * cosine + dy * sine, dy * cosine - dx * sine
    return abs(along) < half[0] + margin and abs(across) < half[1] + margin


@inner
def _cell(x, low, by) -> int:
    """Cell of a coordinate, or the nearest one; `by` is cells a metre."""
    cell = (x - low) * by
    if not cell > 0:  # of what is no number too
        return 0
    return int(cell) if cell < _CELLS - 1 else _CELLS - 1


def _first_box_numba(points, counts, boxes) -> Tensor:
    xyz = points.contiguous().numpy()
    out = np.empty(len(xyz), np.int64)
    start = box_start = 0
    for count, frame in zip(counts, boxes, strict=True):
        cosine, sine = (part.numpy() for part in cos_sin(frame[:, 6]))
        box = out[start : start + count]
        sides = frame.contiguous().numpy(), cosine, sine, xyz.dtype.type(MARGIN)
        _first_box_kernel(xyz[start : start + count], *sides, box)
        box[box >= 0] += box_start
        start, box_start = start + count, box_start + len(frame)
    return torch.from_numpy(out)


def _first_box_triton(points, counts, boxes) -> Tensor:
    from training.ops.gpu.points_in_boxes import first_boxes

    sizes = (stacked_counts(part, points.device) for part in (counts, map(len, boxes)))
    return first_boxes(points, next(sizes), torch.cat(boxes), next(sizes), MARGIN)


def _first_points_numba(points, counts, boxes, samples) -> tuple[Tensor, Tensor]:
    xyz, frames = points.contiguous().numpy(), boxes.contiguous().numpy()
    idx = np.zeros((*frames.shape[:2], samples), np.int64)
    empty = np.empty(frames.shape[:2], bool)
    cosine, sine = (part.numpy() for part in cos_sin(boxes[..., 6]))
    start, margin = 0, xyz.dtype.type(MARGIN)
    for b, count in enumerate(counts):
        sides = frames[b], cosine[b], sine[b], margin
        _first_points_kernel(xyz[start : start + count], *sides, start, idx[b], empty[b])
        start += count
    return torch.from_numpy(idx).flatten(0, 1), torch.from_numpy(empty).flatten()


def _first_points_triton(points, counts, boxes, samples) -> tuple[Tensor, Tensor]:
    from training.ops.gpu.points_in_boxes import first_points

    sizes = stacked_counts(counts, points.device)
    box_sizes = torch.full_like(sizes, boxes.shape[1])
    idx, hits = first_points(points, sizes, boxes.flatten(0, 1), box_sizes, samples, MARGIN)
    turn = torch.arange(samples, device=points.device) % hits.clamp_min(1)[:, None]
    return idx.gather(1, turn), hits == 0

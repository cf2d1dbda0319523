"""Furthest point sampling: points that cover a cloud evenly."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.base.kernel_cache import njit
from training.ops.grouping import stacked_counts

_THREADS = 1024
"""Largest block of upstream's kernel; fixes which of several furthest points it takes."""


def furthest_point_sample(
    xyz: Tensor, counts: Sequence[int], samples: int
) -> tuple[Tensor, list[int]]:
    """Choose rows of points, each the furthest from those before it, starting with the first.

    PointNet++ (Qi et al., NeurIPS 2017), section 3.2. Of equally far points it takes the one that
    OpenPCDet's CUDA kernel takes. Points (N, 3) are finite, frame after frame, `counts` of them.

    Returns rows of `xyz`, int64, `samples` for each frame that has points; a frame with fewer
    repeats its rows in their order. And the chosen points of each frame, one number each."""
    search = _furthest_numba if xyz.is_cpu else _furthest_triton
    rows = search(xyz.detach(), counts, samples)
    return rows, [samples if count else 0 for count in counts]


def _tie_order(count: int) -> NDArray[np.int64]:
    """Rows 0 … count - 1 sorted so that the first of equally far ones is upstream's choice.

    Thread t of a block looks at rows t, t + threads, … and keeps the first; a tree that halves the
    block then prefers the thread whose number is smallest when its bits are read backwards. Fewer
    points stand in the same order: a smaller block reads fewer bits, of smaller numbers."""
    threads = min(1 << (count.bit_length() - 1), _THREADS)
    backwards = np.zeros(1, np.int64)
    while len(backwards) < threads:
        backwards = np.concatenate([2 * backwards, 2 * backwards + 1])
    rows = (backwards[:, None] + np.arange(0, count, threads)).flatten()
    return rows[rows < count]


def _furthest_rows(xyz: NDArray[np.floating], samples: int) -> NDArray[np.int64]:
    """Rows of `xyz` (N, 3), `samples` or all; of equally far rows the lowest.

    Points are packed into boxes of about √N neighbours, strips along x cut along y (S. Leutenegger
    et al., STR: a simple and efficient algorithm for R-tree packing, 1997). A box that the new
    point cannot bring closer is left alone; rounding is monotonic, so the result is that of the
    full search to the last bit."""
    count = len(xyz)
    size = max(16, int(np.sqrt(count)))
    starts = np.arange(0, count, size)
    strip = int(np.ceil(np.sqrt(len(starts)))) * size
    by_x = np.argsort(xyz[:, 0])
    strips = (by_x[start : start + strip] for start in range(0, count, strip))
    rows = np.concatenate([part[np.argsort(xyz[part, 1])] for part in strips])
    rows = np.sort(np.arange(count) // size * count + rows) % count  # rising within each box
    packed = xyz[rows]
    low, high = (bound.reduceat(packed, starts) for bound in (np.minimum, np.maximum))
    chosen = np.zeros(min(samples, count), np.int64)
    _furthest_kernel(xyz, packed.T.copy(), rows, size, low, high, chosen)
    return chosen


@njit(cache=True)
def _furthest_kernel(xyz, packed, rows, size, low, high, chosen):
    """Fill `chosen` from its second row on.

    `packed` (3, N) are the points of `rows`, box by box, `low` and `high` (boxes, 3) the corners of
    each box of `size`."""
    count, boxes = len(rows), len(low)
    x, y, z = packed[0], packed[1], packed[2]
    distance = np.full(count, np.inf, xyz.dtype)
    furthest = np.full(boxes, np.inf, xyz.dtype)
    furthest_row = np.zeros(boxes, np.int64)
    for j in range(1, len(chosen)):
        px, py, pz = xyz[chosen[j - 1], 0], xyz[chosen[j - 1], 1], xyz[chosen[j - 1], 2]
        best, best_row = distance.dtype.type(-1), 0
        for b in range(boxes):
            dx = max(low[b, 0] - px, px - high[b, 0], distance.dtype.type(0))
            dy = max(low[b, 1] - py, py - high[b, 1], distance.dtype.type(0))
            dz = max(low[b, 2] - pz, pz - high[b, 2], distance.dtype.type(0))
            if dx * dx + dy * dy + dz * dz < furthest[b]:
                start, stop = b * size, min((b + 1) * size, count)
                for k in range(start, stop):
                    dx, dy, dz = x[k] - px, y[k] - py, z[k] - pz
                    distance[k] = min(distance[k], dx * dx + dy * dy + dz * dz)
                largest = start
                for k in range(start + 1, stop):
                    if distance[k] > distance[largest]:
                        largest = k
                furthest[b] = distance[largest]
                furthest_row[b] = rows[largest]
            if furthest[b] > best or (furthest[b] == best and furthest_row[b] < best_row):
                best, best_row = furthest[b], furthest_row[b]
        chosen[j] = best_row


def _furthest_numba(xyz: Tensor, counts: Sequence[int], samples: int) -> Tensor:
    chosen: list[NDArray[np.int64]] = [np.empty(0, np.int64)]
    start = 0
    for count in counts:
        if count:
            rows = start + _tie_order(count)
            chosen.append(np.resize(rows[_furthest_rows(xyz.numpy()[rows], samples)], samples))
        start += count
    return torch.from_numpy(np.concatenate(chosen))


def _furthest_triton(xyz: Tensor, counts: Sequence[int], samples: int) -> Tensor:
    from training.ops.gpu.sampling import furthest_rows

    sizes = stacked_counts(filter(None, counts), xyz.device)
    starts = sizes.cumsum(0) - sizes
    return (
        starts[:, None] + furthest_rows(xyz, starts, sizes, samples, max(counts, default=0))
    ).flatten()

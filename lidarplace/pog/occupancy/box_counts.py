"""Number of frames in which the centre of each voxel lies in a box.

All columns of a box share one run of voxels along z, and in a row of constant x its voxels are one
run along y. So a box is written row by row, as the four corners of a rectangle of a second
difference, and one pass at the end adds the differences up. Where boxes of a frame overlap, the
rectangle is cut into those that hold none of the voxels which the frame has counted already."""

import math

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.base.roi import Roi


def count_boxes(
    geometry: NDArray[np.float64], frame: NDArray[np.int64], roi: Roi
) -> NDArray[np.int32]:
    """Return the number of frames in which a voxel's centre lies in a box or on its surface.

    Shape (nx, ny, nz), int32. `geometry` has the columns of `lidarplace.logs.boxes.GEOMETRY`, shape
    (boxes, 7), finite; `frame` is that of each box, shape (boxes,); the boxes of a frame stand
    together."""
    nx, ny, nz = roi.shape
    counts = np.zeros((nx, ny, nz), np.int32)
    if len(frame):
        grid = (roi.minimum, roi.resolution, *map(roi.centres, range(3)))
        _count(geometry, frame, grid, np.zeros((nz, nx, ny), np.int32), counts)
    return counts


@inner
def _slab(a, b, half, offset, centres, minimum, resolution):
    """Return first and last centre with |a + b d| <= half, d = centre - offset; none: first > last.

    The ends are guessed by division, then moved to where the test itself changes. Rounding is
    monotone, so the test holds for one run of voxels."""
    n = len(centres)
    if b == 0:
        return (0, n - 1) if abs(a) <= half else (0, -1)
    if b < 0:  # |-a - b d| is the same, and its inside grows with d
        a, b = -a, -b
    start = (offset - minimum) / resolution - 0.5
    guess = np.ceil((-half - a) / b / resolution + start)
    first = int(min(max(guess, 0.0), n))
    while first > 0 and a + b * (centres[first - 1] - offset) >= -half:
        first -= 1
    while first < n and a + b * (centres[first] - offset) < -half:
        first += 1
    guess = np.floor((half - a) / b / resolution + start)
    last = int(min(max(guess, -1.0), n - 1))
    while last < n - 1 and a + b * (centres[last + 1] - offset) <= half:
        last += 1
    while last >= 0 and a + b * (centres[last] - offset) > half:
        last -= 1
    return first, last


@inner
def _reach(centre, half, minimum, resolution, n):
    """Return first and last of n voxels within `half` of `centre`, and up to one more."""
    first = np.floor((centre - half - minimum) / resolution - 0.5)
    last = np.ceil((centre + half - minimum) / resolution - 0.5)
    if first >= n or last < 0:
        return 0, -1
    return int(max(first, 0.0)), int(min(last, n - 1.0))


@inner
def _inside(box, y):
    along, across, c, s, centre, half_length, half_width = box
    d = y - centre
    return (abs(along + s * d) <= half_length) & (abs(c * d - across) <= half_width)


@inner
def _run(dx, sides, ys, minimum, resolution):
    """Return first and last voxel of a row of constant x with centres in a box.

    There are none if first > last.

    `dx` is x of the row from the centre of the box; `sides` are y, cos, sin, length / 2, width / 2,
    the index along y of the centre, voxels a metre along y for the sides along and across the box,
    and the rounding of an index."""
    y, c, s, half_length, half_width, start, per_along, per_across, rounding = sides
    along, across = c * dx, s * dx
    reach_along, reach_across = abs(half_length * per_along), abs(half_width * per_across)
    middle_along, middle_across = start - along * per_along, start + across * per_across
    low = max(middle_along - reach_along, middle_across - reach_across)
    high = min(middle_along + reach_along, middle_across + reach_across)
    if low - high > rounding:
        return 0, -1
    n = len(ys)
    low, high = max(np.ceil(low), 0.0), min(np.floor(high), n - 1.0)
    if low <= high:
        first, last = int(low), int(high)
        before, after = max(first - 1, 0), min(last + 1, n - 1)
        box = along, across, c, s, y, half_length, half_width
        if (
            _inside(box, ys[first])
            and _inside(box, ys[last])
            and (before == first or not _inside(box, ys[before]))
            and (after == last or not _inside(box, ys[after]))
        ):
            return first, last
    # Empty, or rounding has moved an end: each pair of sides by its own exact test.
    first, last = _slab(along, s, half_length, y, ys, minimum, resolution)
    other_first, other_last = _slab(-across, c, half_width, y, ys, minimum, resolution)
    return max(first, other_first), min(last, other_last)


@inner
def _add(changes, i, j0, j1, k0, k1):
    """Add one to the voxels [i, j0:j1 + 1, k0:k1 + 1], as a second difference."""
    nz, _, ny = changes.shape
    changes[k0, i, j0] += 1
    if j1 + 1 < ny:
        changes[k0, i, j1 + 1] -= 1
    if k1 + 1 < nz:
        changes[k1 + 1, i, j0] -= 1
        if j1 + 1 < ny:
            changes[k1 + 1, i, j1 + 1] += 1


@inner
def _overlapping(others, n, j0, j1, k0, k1):
    """Return the first of `others` from n on that holds a voxel of a rectangle, or their number."""
    while n < len(others) and (
        others[n, 0] > j1 or others[n, 1] < j0 or others[n, 2] > k1 or others[n, 3] < k0
    ):
        n += 1
    return n


@inner
def _add_new(changes, i, j0, j1, k0, k1, others):
    """Add one to the voxels but those of `others`: rows of first and last j, first and last k."""
    parts = [(j0, j1, k0, k1, 0)]
    while parts:
        j0, j1, k0, k1, n = parts.pop()
        n = _overlapping(others, n, j0, j1, k0, k1)
        if n == len(others):
            _add(changes, i, j0, j1, k0, k1)
            continue
        left, right, bottom, top = others[n]
        if j0 < left:
            parts.append((j0, left - 1, k0, k1, n))
        if j1 > right:
            parts.append((right + 1, j1, k0, k1, n))
        j0, j1 = max(j0, left), min(j1, right)
        if k0 < bottom:
            parts.append((j0, j1, k0, bottom - 1, n))
        if k1 > top:
            parts.append((j0, j1, top + 1, k1, n))


@inner
def _sum_up(changes, i, j0, j1, k0, k1, counts):
    """Turn the second differences of row i, which are zero outside, into counts."""
    along_z = np.zeros(j1 - j0 + 1, np.int32)
    for k in range(k0, k1 + 1):
        along_y = np.int32(0)
        for j in range(j0, j1 + 1):
            along_y += changes[k, i, j]
            along_z[j - j0] += along_y
            counts[i, j, k] = along_z[j - j0]


@inner
def _rounding(box, grid):
    """Return the rounding of a coordinate in the frame of a box, in metres.

    It matters for boxes far away."""
    minimum, resolution, xs, ys, _ = grid
    extent = abs(minimum[0]) + abs(minimum[1]) + (len(xs) + len(ys)) * resolution
    return 1e-14 * (abs(box[0]) + abs(box[1]) + box[3] + box[4] + extent)


@inner
def _bounds(box, grid):
    """Return first and last voxel on each axis that a box can reach, along z exact."""
    x, y, z, length, width, height, yaw = box
    minimum, resolution, xs, ys, zs = grid
    c, s, rounding = abs(math.cos(yaw)), abs(math.sin(yaw)), _rounding(box, grid)
    reach_x, reach_y = (c * length + s * width) / 2, (s * length + c * width) / 2
    i0, i1 = _reach(x, reach_x + rounding, minimum[0], resolution, len(xs))
    j0, j1 = _reach(y, reach_y + rounding, minimum[1], resolution, len(ys))
    k0, k1 = _slab(0.0, 1.0, height / 2, z, zs, minimum[2], resolution)
    return i0, (i0 - 1 if j0 > j1 or k0 > k1 else i1), j0, j1, k0, k1


@inner
def _sides(box, grid):
    """Return `sides` of `_run`."""
    minimum, resolution, _, _, _ = grid
    c, s = math.cos(box[6]), math.sin(box[6])
    # Voxels a metre along y for each side of the box; large, not infinite, along an axis.
    per_along = 1 / (resolution * s) if abs(s) > 1e-200 else 1e200 / resolution
    per_across = 1 / (resolution * c) if abs(c) > 1e-200 else 1e200 / resolution
    slack = _rounding(box, grid) * (abs(per_along) + abs(per_across))
    at = (box[1] - minimum[1]) / resolution - 0.5
    return box[1], c, s, box[3] / 2, box[4] / 2, at, per_along, per_across, slack


@inner
def _list_near(reach, n, near):
    """List in `near` the boxes before the n-th whose reach meets its reach; return their number."""
    number = 0
    for m in range(n):
        meets = reach[m, 0] <= reach[m, 1]
        for c in range(0, 6, 2):
            meets &= (reach[m, c] <= reach[n, c + 1]) & (reach[m, c + 1] >= reach[n, c])
        near[number] = m
        number += meets
    return number


@njit(cache=True, nogil=True, error_model="numpy")
def _count(boxes, frame, grid, changes, counts):
    """Count boxes in `counts`, shape (nx, ny, nz), which is zero as is `changes`."""
    minimum, resolution, xs, ys, _ = grid
    nx, ny, nz = counts.shape
    j_first, j_last, k_first, k_last = np.full(nx, ny), np.full(nx, -1), nz, -1
    begin = 0
    while begin < len(boxes):
        end = begin + 1
        while end < len(boxes) and frame[end] == frame[begin]:
            end += 1
        reach = np.empty((end - begin, 6), np.int64)
        start = np.zeros(end - begin + 1, np.int64)  # of the rows of each box in `runs`
        for n in range(end - begin):
            for c, bound in enumerate(_bounds(boxes[begin + n], grid)):
                reach[n, c] = bound
            start[n + 1] = start[n] + max(reach[n, 1] - reach[n, 0] + 1, 0)
        runs = np.empty((start[-1], 2), np.int64)
        near, others = np.empty(end - begin, np.int64), np.empty((end - begin, 4), np.int64)
        for n in range(end - begin):
            i0, i1, _, _, k0, k1 = reach[n]
            if i0 > i1:
                continue
            k_first, k_last = min(k_first, k0), max(k_last, k1)
            close, sides = _list_near(reach, n, near), _sides(boxes[begin + n], grid)
            for i in range(i0, i1 + 1):
                j0, j1 = _run(xs[i] - boxes[begin + n, 0], sides, ys, minimum[1], resolution)
                runs[start[n] + i - i0, 0], runs[start[n] + i - i0, 1] = j0, j1
                if j0 > j1:
                    continue
                j_first[i], j_last[i] = min(j_first[i], j0), max(j_last[i], j1)
                number = 0
                for m in near[:close]:
                    row = start[m] + i - reach[m, 0]
                    if start[m] <= row < start[m + 1] and runs[row, 0] <= runs[row, 1]:
                        others[number, 0], others[number, 1] = runs[row, 0], runs[row, 1]
                        others[number, 2], others[number, 3] = reach[m, 4], reach[m, 5]
                        number += 1
                if _overlapping(others[:number], 0, j0, j1, k0, k1) == number:  # mostly
                    _add(changes, i, j0, j1, k0, k1)
                else:
                    _add_new(changes, i, j0, j1, k0, k1, others[:number])
        begin = end
    for i in range(nx):
        if j_first[i] <= j_last[i]:
            _sum_up(changes, i, j_first[i], j_last[i], k_first, k_last, counts)

"""Overlap of rotated boxes and non-maximum suppression; numbers are float64 throughout."""

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.ops.gpu.launch import launch

_ROWS = 16
_COLUMNS = 64
_BITS = 64  # boxes of a word of the mask


def iou_3d(a: Tensor, b: Tensor) -> Tensor:
    """IoU of the volumes of boxes (B, N, 7) and (B, M, 7) of each frame, (B, N, M)."""
    frames, rows, columns = len(a), a.shape[1], b.shape[1]
    out = a.new_empty(frames, rows, columns)
    tiles = triton.cdiv(rows, _ROWS) * triton.cdiv(columns, _COLUMNS)
    arguments = (a.contiguous(), b.contiguous(), out, rows, columns)
    launch(_iou_kernel, frames * tiles, *arguments, warps=8, ROWS=_ROWS, COLUMNS=_COLUMNS)
    return out


def unsuppressed(
    boxes: Tensor, sizes: Tensor, threshold: float, limit: int
) -> tuple[Tensor, Tensor]:
    """Select the boxes that survive among the first `sizes` (B,) of (B, N, 7), best first.

    Returns their rows (B, limit) int64, zeros behind the last, and their counts (B,)."""
    frames, count = boxes.shape[:2]
    words = triton.cdiv(count, _BITS)
    bits = torch.empty(frames, count, words, dtype=torch.int64, device=boxes.device)
    rows = torch.zeros(frames, limit, dtype=torch.int64, device=boxes.device)
    counts = torch.zeros(frames, dtype=torch.int64, device=boxes.device)
    # A number would be rounded to float32.
    least = torch.full((1,), threshold, dtype=torch.float64, device=boxes.device)
    tiles = triton.cdiv(count, _ROWS) * words
    overlaps = (boxes.contiguous(), sizes, least, bits, count)
    launch(_overlap_kernel, frames * tiles, *overlaps, warps=8, ROWS=_ROWS, BITS=_BITS)
    width = triton.next_power_of_2(max(1, words))
    survivors = (bits, sizes, rows, counts, count, limit)
    launch(_survivor_kernel, frames, *survivors, warps=16, BITS=_BITS, WORDS=width)
    return rows, counts


@triton.jit(do_not_specialize=["rows"])
def _iou_kernel(a, b, out, rows, columns, ROWS: tl.constexpr, COLUMNS: tl.constexpr):
    across = tl.cdiv(columns, COLUMNS)
    tiles = tl.cdiv(rows, ROWS) * across
    frame, tile = (tl.program_id(0) // tiles).to(tl.int64), tl.program_id(0) % tiles
    row = tile // across * ROWS + tl.arange(0, ROWS)
    column = tile % across * COLUMNS + tl.arange(0, COLUMNS)
    a += (frame * rows + row) * 7
    b += (frame * columns + column) * 7
    at_row, at_column = row < rows, column < columns
    size_a, size_b, common = _sizes_and_common(a, b, at_row, at_column)
    z, height = _column(a, 2, at_row)[:, None], _column(a, 5, at_row)[:, None]
    other_z, other_height = _column(b, 2, at_column)[None, :], _column(b, 5, at_column)[None, :]
    top = tl.minimum(z + 0.5 * height, other_z + 0.5 * other_height)
    bottom = tl.maximum(z - 0.5 * height, other_z - 0.5 * other_height)
    volume_a, volume_b = size_a * height, size_b * other_height
    common = common * tl.maximum(top - bottom, 0.0)
    common = tl.minimum(common, tl.minimum(volume_a, volume_b))
    union = volume_a + volume_b - common
    iou = tl.where(union > 0, common / tl.where(union > 0, union, 1.0), 0.0)
    place = out + (frame * rows + row[:, None]) * columns + column[None, :]
    tl.store(place, iou.to(out.dtype.element_ty), at_row[:, None] & at_column[None, :])


@triton.jit(do_not_specialize=["count"])
def _overlap_kernel(boxes, sizes, least, bits, count, ROWS: tl.constexpr, BITS: tl.constexpr):
    """A bit for each better box that overlaps too much, in words of the rows of boxes."""
    words = tl.cdiv(count, BITS)
    tiles = tl.cdiv(count, ROWS) * words
    frame, tile = (tl.program_id(0) // tiles).to(tl.int64), tl.program_id(0) % tiles
    first, word = tile // words * ROWS, tile % words
    size = tl.load(sizes + frame)
    if (first < size) & (word * BITS < first + ROWS):
        row, better = first + tl.arange(0, ROWS), word * BITS + tl.arange(0, BITS)
        boxes += frame * count * 7
        at_row, at_column = row < size, better < size
        a, b = boxes + better * 7, boxes + row * 7
        pair = (better[:, None] < row[None, :]) & at_row[None, :]
        limit = tl.load(least)
        word_bits = tl.zeros((ROWS,), tl.int64)
        if tl.max((pair & _could_exceed(a, b, at_column, at_row, limit)).to(tl.int32)) > 0:
            size_a, size_b, common = _sizes_and_common(a, b, at_column, at_row)
            union = size_a + size_b - common
            hit = tl.where(union > 0, common / tl.where(union > 0, union, 1.0), 0.0) > limit
            bit = (hit & pair).to(tl.int64) << tl.arange(0, BITS).to(tl.int64)[:, None]
            word_bits = tl.sum(bit, 0)
        tl.store(bits + (frame * count + row) * words + word, word_bits, at_row)


@triton.jit(do_not_specialize=["rows", "count"])
def _survivor_kernel(
    bits, sizes, rows, counts, count, limit, BITS: tl.constexpr, WORDS: tl.constexpr
):
    """Survivors of a frame, a word after the other, in order."""
    frame = tl.program_id(0).to(tl.int64)
    words = tl.cdiv(count, BITS)
    size = tl.load(sizes + frame).to(tl.int32)
    bits += frame * count * words
    lane, column = tl.arange(0, BITS), tl.arange(0, WORDS)
    weight = lane.to(tl.int64)
    alive = tl.zeros((WORDS,), tl.int64)
    word = 0
    survivors = tl.zeros((), tl.int32)
    while (word * BITS < size) & (survivors < limit):
        row = word * BITS + lane
        earlier = (row < size)[:, None] & (column < word)[None, :]
        masks = tl.load(bits + row[:, None] * words + column[None, :], earlier, 0)
        free = (row < size) & (tl.max(((masks & alive[None, :]) != 0).to(tl.int32), 1) == 0)
        # Those of this word that no survivor removes, until nothing changes: Zheng et al.,
        # Cluster NMS, 2020.
        same_word = tl.load(bits + row * words + word, row < size, 0)
        survives = free
        before = tl.zeros((), tl.int64)
        now = tl.sum(survives.to(tl.int64) << weight, 0)
        while before != now:
            before = now
            survives = free & ((same_word & now) == 0)
            now = tl.sum(survives.to(tl.int64) << weight, 0)
        alive = tl.where(column == word, now, alive)
        place = survivors + tl.cumsum(survives.to(tl.int32), 0) - 1
        tl.store(rows + frame * limit + place, row.to(tl.int64), survives & (place < limit))
        survivors = tl.minimum(limit, survivors + tl.sum(survives.to(tl.int32), 0))
        word += 1
    tl.store(counts + frame, survivors.to(tl.int64))


@triton.jit
def _could_exceed(a, b, at_a, at_b, threshold):
    """Test if the IoU of each pair may exceed the threshold, see `training.ops.rotated_iou`."""
    length, width = _column(a, 3, at_a)[:, None], _column(a, 4, at_a)[:, None]
    other_length, other_width = _column(b, 3, at_b)[None, :], _column(b, 4, at_b)[None, :]
    dx = _column(b, 0, at_b)[None, :] - _column(a, 0, at_a)[:, None]
    dy = _column(b, 1, at_b)[None, :] - _column(a, 1, at_a)[:, None]
    yaw, other_yaw = _column(a, 6, at_a), _column(b, 6, at_b)
    cos_a, sin_a = tl.cos(yaw)[:, None], tl.sin(yaw)[:, None]
    cos_b, sin_b = tl.cos(other_yaw)[None, :], tl.sin(other_yaw)[None, :]
    x, y = tl.abs(cos_a * dx + sin_a * dy), tl.abs(cos_a * dy - sin_a * dx)
    cos, sin = tl.abs(cos_a * cos_b + sin_a * sin_b), tl.abs(cos_a * sin_b - sin_a * cos_b)
    half_x = 0.5 * (cos * other_length + sin * other_width)
    half_y = 0.5 * (sin * other_length + cos * other_width)
    wide = tl.minimum(tl.minimum(0.5 * length + half_x - x, length), 2 * half_x)
    deep = tl.minimum(tl.minimum(0.5 * width + half_y - y, width), 2 * half_y)
    size_a, size_b = length * width, other_length * other_width
    common = tl.minimum(wide * deep, tl.minimum(size_a, size_b))
    enough = common * (1 + 1e-9) >= threshold * (size_a + size_b - common)
    return (wide >= 0) & (deep >= 0) & enough


@triton.jit
def _sizes_and_common(a, b, at_a, at_b):
    """Areas of boxes (N, 1) and (1, M) seen from above, and the area common to each pair (N, M).

    The integral that `training.ops.rotated_iou` explains."""
    length, width = _column(a, 3, at_a)[:, None], _column(a, 4, at_a)[:, None]
    other_length, other_width = _column(b, 3, at_b)[None, :], _column(b, 4, at_b)[None, :]
    half_x, half_y, along, across = 0.5 * length, 0.5 * width, 0.5 * other_length, 0.5 * other_width
    dx = _column(b, 0, at_b)[None, :] - _column(a, 0, at_a)[:, None]
    dy = _column(b, 1, at_b)[None, :] - _column(a, 1, at_a)[:, None]
    yaw, other_yaw = _column(a, 6, at_a), _column(b, 6, at_b)
    cos_a, sin_a = tl.cos(yaw)[:, None], tl.sin(yaw)[:, None]
    cos_b, sin_b = tl.cos(other_yaw)[None, :], tl.sin(other_yaw)[None, :]
    x, y = cos_a * dx + sin_a * dy, cos_a * dy - sin_a * dx
    cos, sin = cos_a * cos_b + sin_a * sin_b, cos_a * sin_b - sin_a * cos_b
    c, s = tl.abs(cos), tl.abs(sin)
    apart = tl.abs(x) >= half_x + c * along + s * across
    apart |= tl.abs(y) >= half_y + s * along + c * across
    apart |= tl.abs(cos * x + sin * y) >= along + c * half_x + s * half_y
    apart |= tl.abs(cos * y - sin * x) >= across + s * half_x + c * half_y
    area = tl.zeros_like(x)
    for i in tl.static_range(4):
        u, v = along * (1 - (i + 1) // 2 % 2 * 2), across * (1 - i // 2 * 2)
        x0, y0 = x + cos * u - sin * v, y + sin * u + cos * v
        u, v = u * (i % 2 * 2 - 1), v * (1 - i % 2 * 2)
        x1, y1 = x + cos * u - sin * v, y + sin * u + cos * v
        low, high = _clamped(y0, half_y), _clamped(y1, half_y)
        span = tl.where(y1 != y0, y1 - y0, 1.0)
        left, right = x0 + (low - y0) / span * (x1 - x0), x0 + (high - y0) / span * (x1 - x0)
        start, end = _clamped(left, half_x), _clamped(right, half_x)
        span = tl.where(right != left, right - left, 1.0)
        outside = ((start - left) - (right - end)) / span
        area += (high - low) * 0.5 * (start + end + outside * (start - end))
    size_a, size_b = length * width, other_length * other_width
    common = tl.minimum(tl.maximum(area, 0.0), tl.minimum(size_a, size_b))
    return size_a, size_b, tl.where(apart, 0.0, common)


@triton.jit
def _column(boxes, column: tl.constexpr, inside):
    return tl.load(boxes + column, inside, 0.0).to(tl.float64)


@triton.jit
def _clamped(value, half):
    return tl.minimum(tl.maximum(value, -half), half)

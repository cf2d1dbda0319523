"""Assignment of objects to anchors: the best overlap of each object, then of each anchor."""

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.ops.gpu.launch import launch

_LANES = 1024


def assign(anchors: Tensor, rules: Tensor, boxes: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
    """Labels that the anchors (…, K, 7) learn and the rows of their objects, (B, A) int64 each.

    `anchors` and `rules` (K, 3) as in `training.detectors.heads.anchor_targets`; boxes (B, M, 7)
    and labels (B, M), 0 for none."""
    frames, objects = labels.shape
    kinds, count = len(rules), anchors.shape[:-1].numel()
    most = torch.empty(frames, objects, dtype=torch.float32, device=boxes.device)
    learnt = torch.empty(frames, count, dtype=torch.int64, device=boxes.device)
    chosen = torch.empty_like(learnt)
    shared = (anchors.contiguous(), rules.contiguous(), boxes.contiguous(), labels, most)
    sizes = (count, kinds, objects)
    launch(_object_kernel, frames * objects, *shared, *sizes, LANES=_LANES)
    programs = frames * triton.cdiv(count, _LANES)
    launch(_anchor_kernel, programs, *shared, learnt, chosen, *sizes, LANES=_LANES)
    return learnt, chosen


@triton.jit(do_not_specialize=["count"])
def _object_kernel(anchors, rules, boxes, labels, most, count, kinds, objects, LANES: tl.constexpr):
    """The largest overlap of an object with an anchor of its class."""
    place = tl.program_id(0).to(tl.int64)
    label = tl.load(labels + place)
    x0, y0, x1, y1 = _edges(boxes + place * 7, True)
    largest = tl.zeros((LANES,), tl.float32)
    if label > 0:
        for low in range(0, count, LANES):
            anchor = low + tl.arange(0, LANES)
            inside = anchor < count
            ax0, ay0, ax1, ay1 = _edges(anchors + anchor * 7, inside)
            same = inside & (tl.load(rules + anchor % kinds * 3, inside, 0.0).to(tl.int64) == label)
            overlap, touches = _overlap(x0, y0, x1, y1, ax0, ay0, ax1, ay1)
            largest = tl.maximum(largest, tl.where(same & touches, overlap, 0.0))
    tl.store(most + place, tl.max(largest, 0))


@triton.jit(do_not_specialize=["count"])
def _anchor_kernel(
    anchors, rules, boxes, labels, most, learnt, chosen, count, kinds, objects, LANES: tl.constexpr
):
    """The object that each of some anchors overlaps most, and what they learn."""
    blocks = tl.cdiv(count, LANES)
    frame = (tl.program_id(0) // blocks).to(tl.int64)
    anchor = tl.program_id(0) % blocks * LANES + tl.arange(0, LANES)
    inside = anchor < count
    ax0, ay0, ax1, ay1 = _edges(anchors + anchor * 7, inside)
    rules += anchor % kinds * 3
    own = tl.load(rules, inside, 0.0).to(tl.int64)
    best = tl.zeros((LANES,), tl.float32)
    row = tl.zeros((LANES,), tl.int64)
    forced = tl.zeros((LANES,), tl.int1)
    for m in range(objects):
        place = frame * objects + m
        x0, y0, x1, y1 = _edges(boxes + place * 7, True)
        overlap, touches = _overlap(x0, y0, x1, y1, ax0, ay0, ax1, ay1)
        touches &= own == tl.load(labels + place)
        forced |= touches & (overlap == tl.load(most + place))
        better = touches & (overlap > best)
        best, row = tl.where(better, overlap, best), tl.where(better, m, row)
    matched = tl.load(rules + 1, inside, 0.0).to(tl.float32)
    unmatched = tl.load(rules + 2, inside, 0.0).to(tl.float32)
    label = tl.where(forced | (best >= matched), own, tl.where(best < unmatched, 0, -1))
    tl.store(learnt + frame * count + anchor, label, inside)
    tl.store(chosen + frame * count + anchor, row, inside)


@triton.jit
def _edges(boxes, inside):
    """Lowest x and y, then highest, of boxes turned to the nearest multiple of 90 degrees."""
    x, y = _column(boxes, 0, inside), _column(boxes, 1, inside)
    length, width = _column(boxes, 3, inside), _column(boxes, 4, inside)
    yaw = _column(boxes, 6, inside)
    pi = tl.full((), 3.141592653589793, tl.float32)
    turn = yaw - tl.floor(tl.div_rn(yaw, tl.zeros_like(yaw) + pi) + 0.5) * pi
    across = tl.abs(turn) >= 0.25 * pi
    half_x = tl.where(across, width, length) * 0.5
    half_y = tl.where(across, length, width) * 0.5
    return x - half_x, y - half_y, x + half_x, y + half_y


@triton.jit
def _overlap(x0, y0, x1, y1, ax0, ay0, ax1, ay1):
    """IoU of rectangles with these edges, and where they have a common area; rounded as on a CPU.

    The first is an object, the others anchors."""
    dx = tl.minimum(x1, ax1) - tl.maximum(x0, ax0)
    dy = tl.minimum(y1, ay1) - tl.maximum(y0, ay0)
    common = dx * dy
    union = (x1 - x0) * (y1 - y0) + (ax1 - ax0) * (ay1 - ay0) - common
    return tl.div_rn(common, tl.maximum(union, 1e-6)), (dx > 0) & (dy > 0)


@triton.jit
def _column(boxes, column: tl.constexpr, inside):
    return tl.load(boxes + column, inside, 0.0).to(tl.float32)

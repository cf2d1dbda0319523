"""Targets of the anchors: which of them learn an object, which background."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional
from torch.nn.utils.rnn import pad_sequence

from lidarplace.base.kernel_cache import njit
from training.detectors.detector import Rows
from training.detectors.heads.anchors import AnchorClass
from training.detectors.heads.box_coder import limit_period
from training.ops.nms import rows_of

Index = tuple[Tensor | slice, Tensor | slice]
"""Frames and anchors: (P,) each, or slices of all."""
ALL: Index = (slice(None), slice(None))


@dataclass(frozen=True)
class AnchorTargets:
    """Targets of the A anchors of B frames."""

    labels: Tensor  # label of the object, 0 for background, -1 for neither, shape (B, A), int64
    index: Index  # the anchors with an object; on a GPU all, as their number is not known
    boxes: Tensor  # objects of the anchors of `index`, shape (P, 7) or (B, A, 7)


def anchor_rules(classes: Sequence[AnchorClass]) -> Tensor:
    """Label, `matched` and `unmatched` of each anchor of a cell, (K, 3), labels from 1."""
    return torch.tensor(
        [
            (label, item.matched, item.unmatched)
            for label, item in enumerate(classes, 1)
            for _ in item.rotations
        ]
    )


def assign_targets(anchors: Tensor, rules: Tensor, boxes: Rows, labels: Rows) -> AnchorTargets:
    """Give every anchor (ny, nx, K, 7) an object of its class, background, or neither.

    As OpenPCDet's AxisAlignedTargetAssigner: an anchor takes the object that it overlaps most if
    that is at least `matched`; each object's best anchors learn whatever the overlap. Overlap is
    the IoU from above of boxes turned to the nearest multiple of 90 degrees, in float32.

    `anchors` and `rules`, see `anchor_rules`, are float32. The objects of each frame are boxes
    (M, 7) and labels (M,). All are on one device."""
    assign = _assign_numba if anchors.is_cpu else _assign_triton
    return assign(anchors, rules, boxes, labels)


def _assign_triton(anchors: Tensor, rules: Tensor, boxes: Rows, labels: Rows) -> AnchorTargets:
    from training.ops.gpu.anchor_targets import assign

    # One more box, of zeros and no class, for frames without an object.
    objects = functional.pad(pad_sequence(list(boxes), batch_first=True), (0, 0, 0, 1))
    object_labels = functional.pad(pad_sequence(list(labels), batch_first=True), (0, 1))
    learnt, chosen = assign(anchors, rules, objects, object_labels)
    return AnchorTargets(learnt, ALL, rows_of(objects, chosen))


def _assign_numba(anchors: Tensor, rules: Tensor, boxes: Rows, labels: Rows) -> AnchorTargets:
    frames, count = len(boxes), anchors.shape[:3].numel()
    objects = torch.cat(list(boxes))
    places, sides = objects[:, :2].to(anchors).T, _halves(objects.to(anchors))
    edges = torch.cat([places - sides, places + sides]).numpy()
    x, y = anchors[0, :, :, 0].contiguous().numpy(), anchors[:, 0, :, 1].contiguous().numpy()
    grid = x, y, _halves(anchors[0, 0]).numpy(), rules.numpy()
    learnt = np.empty((frames, *anchors.shape[:3]), np.int64)
    chosen = np.empty(learnt.shape, np.int64)
    first = 0
    for frame, frame_labels in enumerate(labels):
        stop = first + len(frame_labels)
        of_frame = edges[:, first:stop], frame_labels.numpy(), first
        _assign_kernel(*grid, *of_frame, learnt[frame], chosen[frame])
        first = stop
    flat = torch.from_numpy(learnt.reshape(frames, count))
    positive = np.flatnonzero(learnt > 0)
    rows = torch.from_numpy(positive)
    taken = torch.from_numpy(chosen.ravel()[positive])
    return AnchorTargets(flat, (rows // count, rows % count), objects[taken])


def _halves(boxes: Tensor) -> Tensor:
    """Half the sides along x and along y of the turned boxes, (2, N)."""
    sides = boxes[:, 3:5].T
    across = limit_period(boxes[:, 6], 0.5, math.pi).abs() >= math.pi / 4
    return torch.where(across, sides.flip(0), sides) / 2


@njit(cache=True, error_model="numpy")
def _assign_kernel(x, y, halves, rules, edges, labels, first, learnt, chosen):
    """Fill labels and objects of the anchors (ny, nx, K) of a frame.

    Anchors have `x` (nx, K) by column and `y` (ny, K) by row of the grid, both rising, and half
    their sides in `halves` (2, K); `edges` (4, M) are lowest x and y, then highest, of the objects,
    which are numbered from `first` on. Only anchors near an object are compared with it."""
    rows, columns, kinds = learnt.shape
    best = np.zeros(learnt.shape, x.dtype)
    forced = np.zeros(learnt.shape, np.bool_)
    least = x.dtype.type(1e-6)
    chosen[:] = first
    for m in range(len(labels)):
        x0, y0, x1, y1 = edges[:, m]
        area = (x1 - x0) * (y1 - y0)
        most = x.dtype.type(0)
        for again in range(2):  # the second time to mark those with the largest overlap
            for k in range(kinds):
                if rules[k, 0] != labels[m]:
                    continue
                hx, hy = halves[:, k]
                left = _first_beyond(x[:, k], hx, x0)
                for i in range(_first_beyond(y[:, k], hy, y0), rows):
                    low, high = y[i, k] - hy, y[i, k] + hy
                    side, dy = high - low, min(y1, high) - max(y0, low)
                    if not dy > 0:
                        break
                    for j in range(left, columns):
                        low, high = x[j, k] - hx, x[j, k] + hx
                        dx = min(x1, high) - max(x0, low)
                        if not dx > 0:
                            break
                        common = dx * dy
                        overlap = common / max(area + (high - low) * side - common, least)
                        most = max(most, overlap)
                        if again and overlap == most:
                            forced[i, j, k] = True
                        if overlap > best[i, j, k]:
                            best[i, j, k], chosen[i, j, k] = overlap, first + m
    for i in range(rows):
        for j in range(columns):
            for k in range(kinds):
                overlap, learnt[i, j, k] = best[i, j, k], -1
                if forced[i, j, k] or overlap >= rules[k, 1]:
                    learnt[i, j, k] = np.int64(rules[k, 0])
                elif overlap < rules[k, 2]:
                    learnt[i, j, k] = 0


@njit(cache=True)
def _first_beyond(places, half, low):
    """First of the rising places whose upper end is greater than `low`."""
    start, stop = 0, len(places)
    while start < stop:
        middle = (start + stop) // 2
        if places[middle] + half > low:
            stop = middle
        else:
            start = middle + 1
    return start

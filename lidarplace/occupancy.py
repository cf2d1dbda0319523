"""The probabilistic occupancy grid (POG): how often an object of a class fills each voxel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import NDArray

from lidarplace.boxes import GEOMETRY, check_boxes, frame_ids
from lidarplace.roi import Roi


@dataclass(frozen=True)
class OccupancyGrid:
    """Occupancy of the voxels of an ROI by one class of objects.

    The counts are integers, so `p = counts / frames` is exact and grids of the same counts are
    equal whatever the order of the boxes was.

    Attributes:
        roi: the voxels.
        object_class: class of the objects counted.
        counts: number of frames in which a voxel's centre lies in a box, shape (nx, ny, nz), int32.
        frames: number of frames looked at, T; frames without a box count.
    """

    roi: Roi
    object_class: str
    counts: NDArray[np.int32]
    frames: int

    @classmethod
    def from_boxes(
        cls, boxes: pd.DataFrame, roi: Roi, object_class: str, frames: int
    ) -> OccupancyGrid:
        """Count the boxes of `object_class` in a box log (paper, equation of p-hat).

        A voxel is occupied when its centre lies in a box or on its surface. A frame counts once,
        however many boxes overlap in it. Boxes are cut at the ROI.

        Args:
            boxes: rows of the box log; `frame`, `class` and the box geometry are used, and `scene`
                where there is one.
            frames: T, the number of frames that the log covers.

        Raises:
            ValueError: a column is missing, a value is not finite, or the log has more than
                `frames` frames.
        """
        check_boxes(boxes)
        if not 1 <= frames < 2**31:
            raise ValueError(f"frames must be within 1 and 2**31 - 1, found {frames}")
        rows = boxes[boxes["class"] == object_class]
        frame = frame_ids(rows)
        if len(rows) and frame.max() >= frames:
            raise ValueError(
                f"the boxes of class {object_class!r} come from {frame.max() + 1} frames, "
                f"more than frames={frames}"
            )
        order = np.argsort(frame, kind="stable")
        geometry = rows[list(GEOMETRY)].to_numpy(np.float64)[order]
        counts = np.zeros(roi.shape, np.int32)
        _count(geometry, frame[order], roi.minimum, roi.resolution, counts)
        return cls(roi, object_class, counts, frames)

    @cached_property
    def probability(self) -> NDArray[np.float64]:
        """p of every voxel, shape (nx, ny, nz)."""
        return self.counts / self.frames

    @cached_property
    def entropy(self) -> NDArray[np.float64]:
        """H of every voxel in nats, shape (nx, ny, nz)."""
        return self.entropy_of_count[self.counts]

    @cached_property
    def entropy_of_count(self) -> NDArray[np.float64]:
        """H in nats of a voxel that is occupied in 0, 1, ... frames, shape (max count + 1,).

        A grid has few different counts, so entropies are looked up, not computed by voxel.
        """
        return binary_entropy(np.arange(int(self.counts.max()) + 1), self.frames)

    def entropy_sum(self, where: NDArray[np.bool_] | None = None) -> float:
        """Sum of H over the voxels of the mask `where` (all if None), in nats.

        Voxels are counted by their count first. The integers are exact and few terms remain,
        so the sum does not depend on the order of the voxels.
        """
        counts = self.counts.ravel() if where is None else self.counts[where]
        return math.fsum(np.bincount(counts) * self.entropy_of_count[: counts.max(initial=0) + 1])


def binary_entropy(counts: NDArray[np.integer], frames: int) -> NDArray[np.float64]:
    """`H = -p ln p - (1-p) ln(1-p)` of `p = counts / frames`, in nats, 0 at p = 0 and p = 1."""
    p, rest = counts / frames, (frames - counts) / frames
    # The logarithm of a number close to 1 is taken from its distance to 1.
    with np.errstate(divide="ignore", invalid="ignore"):
        log_p = np.where(p < 0.5, np.log(p), np.log1p(-rest))
        log_rest = np.where(p < 0.5, np.log1p(-p), np.log(rest))
        entropy = -p * log_p - rest * log_rest
    return np.where((p > 0) & (rest > 0), entropy, 0.0)


@njit(cache=True)
def _count(boxes, frame, minimum, resolution, counts):  # pragma: no cover - compiled
    """Add one to `counts` for every frame in which a voxel's centre lies in a box.

    boxes: (n, 7) sorted by frame; frame: (n,) ids from 0.
    """
    nx, ny, nz = counts.shape
    last = np.full(counts.shape, -1, np.int32)  # the frame that counted a voxel last
    for b in range(len(boxes)):
        x, y, z, length, width, height, yaw = boxes[b]
        c, s = math.cos(yaw), math.sin(yaw)
        reach_x = abs(c) * length / 2 + abs(s) * width / 2
        reach_y = abs(s) * length / 2 + abs(c) * width / 2
        # One voxel more on each side: the test below decides, not this rounding.
        i0 = max(0.0, math.floor((x - reach_x - minimum[0]) / resolution) - 1)
        i1 = min(nx - 1.0, math.floor((x + reach_x - minimum[0]) / resolution) + 1)
        j0 = max(0.0, math.floor((y - reach_y - minimum[1]) / resolution) - 1)
        j1 = min(ny - 1.0, math.floor((y + reach_y - minimum[1]) / resolution) + 1)
        k0 = max(0.0, math.floor((z - height / 2 - minimum[2]) / resolution) - 1)
        k1 = min(nz - 1.0, math.floor((z + height / 2 - minimum[2]) / resolution) + 1)
        if i1 < i0 or j1 < j0 or k1 < k0:
            continue
        for i in range(int(i0), int(i1) + 1):
            dx = minimum[0] + (i + 0.5) * resolution - x
            for j in range(int(j0), int(j1) + 1):
                dy = minimum[1] + (j + 0.5) * resolution - y
                if abs(c * dx + s * dy) > length / 2 or abs(c * dy - s * dx) > width / 2:
                    continue
                for k in range(int(k0), int(k1) + 1):
                    if abs(minimum[2] + (k + 0.5) * resolution - z) > height / 2:
                        continue
                    if last[i, j, k] != frame[b]:
                        last[i, j, k] = frame[b]
                        counts[i, j, k] += 1

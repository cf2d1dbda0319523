"""The point clouds of many frames in one block of memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PointClouds:
    """Merged clouds of all LiDARs, frame after frame, in the ego frame.

    One block, not a list of arrays: it travels between processes without a copy.

    Attributes:
        points: x, y, z in metres and intensity in [0, 1], shape (N, 4), float32.
        lidar: index of the mount that a point comes from, shape (N,), uint8.
        frames: frame numbers of the box log, shape (F,), int64.
        offsets: points of the i-th frame are `offsets[i]:offsets[i + 1]`, shape (F + 1,), int64.
    """

    points: NDArray[np.float32]
    lidar: NDArray[np.uint8]
    frames: NDArray[np.int64]
    offsets: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> NDArray[np.float32]:
        """Points of the `index`-th frame, shape (n, 4), a view."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame index {index} outside 0..{len(self) - 1}")
        return self.points[self.offsets[index] : self.offsets[index + 1]]

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        return (self[i] for i in range(len(self)))

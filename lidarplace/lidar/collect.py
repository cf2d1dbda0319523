"""Point clouds of a placement: all its LiDARs in every frame of a box log."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from lidarplace.boxes import GEOMETRY, check_boxes
from lidarplace.lidar.clouds import PointClouds
from lidarplace.lidar.raycast import Hits, cast
from lidarplace.lidar.returns import LARGEST_ERROR, sample_points
from lidarplace.placement import Placement

Crop = tuple[float, float, float, float, float, float]


def collect(
    boxes: pd.DataFrame,
    frames: ArrayLike,
    placement: Placement,
    crop: Crop,
    seed: int = 0,
) -> PointClouds:
    """Simulate the merged clouds of all LiDARs of `placement` in the given frames.

    Every placement sees the same objects. Drop-off and range noise of a ray depend on seed, frame
    number, LiDAR and ray only, so frames may be collected in any portions.

    Args:
        boxes: a box log, ego frame; its other frames are ignored.
        frames: frame numbers, shape (F,); a frame without a box shows the ground.
        placement: mounts and LiDAR.
        crop: x0, y0, z0, x1, y1, z1 in the ego frame, metres; points outside are left out.
        seed: of drop-off and range noise.

    Raises:
        ValueError: a box is bad, the crop is empty, or there are more than 256 LiDARs.
    """
    check_boxes(boxes)
    if not all(low < high for low, high in zip(crop[:3], crop[3:], strict=True)):
        raise ValueError(f"crop needs x0 < x1, y0 < y1, z0 < z1, found {crop}")
    if len(placement.mounts) > 256:
        raise ValueError(f"a cloud holds at most 256 LiDARs, found {len(placement.mounts)}")
    numbers = np.asarray(frames, np.int64)
    lidar = placement.lidar
    # A point may err into the crop from outside, so what is cast is a little larger.
    slack = LARGEST_ERROR * lidar.range_noise
    wide = (*(low - slack for low in crop[:3]), *(high + slack for high in crop[3:]))

    memory = np.empty((lidar.rays, 4), np.float32)
    hits: Hits | None = None
    points: list[NDArray[np.float32]] = []
    counts = np.zeros((len(numbers), len(placement.mounts)), np.int64)
    by_frame = _Frames(boxes)
    for f, frame in enumerate(numbers.tolist()):
        around = by_frame[frame]
        for m, mount in enumerate(placement.mounts):
            hits = cast(mount, lidar, around, wide, into=hits)
            count = sample_points(mount, lidar, hits, crop, (seed, frame, m), memory)
            counts[f, m] = count
            points.append(memory[:count].copy())
    mounts = np.tile(np.arange(len(placement.mounts), dtype=np.uint8), len(numbers))
    return PointClouds(
        points=np.concatenate([np.empty((0, 4), np.float32), *points]),
        lidar=np.repeat(mounts, counts.ravel()),
        frames=numbers,
        offsets=np.concatenate([[0], np.cumsum(counts.sum(axis=1))]).astype(np.int64),
    )


class _Frames:
    """The boxes of a log by frame number."""

    def __init__(self, boxes: pd.DataFrame) -> None:
        frame = boxes["frame"].to_numpy(np.int64)
        order = np.argsort(frame, kind="stable")
        self._frame = frame[order]
        self._geometry = boxes[list(GEOMETRY)].to_numpy(np.float64)[order]

    def __getitem__(self, frame: int) -> NDArray[np.float64]:
        first, last = np.searchsorted(self._frame, [frame, frame + 1])
        return self._geometry[first:last]

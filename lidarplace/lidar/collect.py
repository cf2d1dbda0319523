"""Simulate the merged point clouds that a placement collects in a scene."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.boxes import GEOMETRY, check_boxes
from lidarplace.lidar.clouds import PointClouds
from lidarplace.lidar.raycast import background, cast
from lidarplace.lidar.returns import ATTENUATION, points_of
from lidarplace.placement import Placement

Crop = tuple[float, float, float, float, float, float]

OWN_BODY = (0.0, 0.0, 0.75, 4.6, 1.9, 1.5, 0.0)
"""The vehicle itself as a box: it blocks rays, and its returns are dropped."""


def collect(
    boxes: pd.DataFrame, frames: NDArray[np.int64], placement: Placement, crop: Crop, seed: int
) -> PointClouds:
    """Clouds of all LiDARs of `placement` in the given frames of a box log.

    Every beam and azimuth step is cast against the boxes of the frame, the ground at z = 0 and the
    vehicle's own body; the nearest hit wins. All placements see the same poses; the noise depends
    on (seed, frame, LiDAR, ray).

    Args:
        boxes: rows of a box log.
        frames: frame numbers, in the order of the result.
        placement: mounts and the LiDAR with its range, noise and drop-off.
        crop: points outside are left out: x, y, z of the lowest corner, then of the highest.
        seed: of noise and drop-off, >= 0.

    Raises:
        ValueError: a bad box log, or more LiDARs than the index of a point can hold.
    """
    check_boxes(boxes)
    if len(placement.mounts) > 256:
        raise ValueError(f"at most 256 LiDARs, found {len(placement.mounts)}")
    lidar = placement.lidar
    limits = np.array(crop)
    elevations = np.array(lidar.elevations)
    views = []
    for mount in placement.mounts:
        directions = lidar.directions() @ mount.rotation.T
        active = _may_reach(mount.position, directions, limits)
        behind = background(mount.position, directions, lidar.range, np.array(OWN_BODY), active)
        views.append((mount, directions, behind))

    order = np.argsort(boxes["frame"].to_numpy(), kind="stable")
    frame_of_box = boxes["frame"].to_numpy()[order]
    geometry = boxes[list(GEOMETRY)].to_numpy(np.float64)[order]
    parts, indices, sizes = [], [], []
    for frame in frames:
        low, high = np.searchsorted(frame_of_box, [frame, frame + 1])
        size = 0
        for index, (mount, directions, behind) in enumerate(views):
            hits = cast(
                mount.position,
                mount.rotation,
                elevations,
                directions,
                lidar.range,
                geometry[low:high],
                behind,
            )
            points = points_of(
                mount.position,
                directions,
                *hits,
                lidar.range_noise,
                lidar.drop_off,
                ATTENUATION,
                limits,
                (seed, int(frame), index),
            )
            parts.append(points)
            indices.append(np.full(len(points), index, np.uint8))
            size += len(points)
        sizes.append(size)
    return PointClouds(
        points=np.concatenate(parts) if parts else np.empty((0, 4), np.float32),
        lidar=np.concatenate(indices) if indices else np.empty(0, np.uint8),
        frames=np.asarray(frames, np.int64),
        offsets=np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]).astype(np.int64),
    )


def _may_reach(
    origin: NDArray[np.float64], directions: NDArray[np.float64], crop: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Rays that pass through the crop; noise moves a point along its ray, so no other can give one.

    The crop is grown by a millimetre, so that rounding cuts off no ray.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        t0 = (crop[:3] - 1e-3 - origin) / directions
        t1 = (crop[3:] + 1e-3 - origin) / directions
    # 0 / 0 is a ray within a face of the grown crop: as good as inside.
    near = np.nan_to_num(np.minimum(t0, t1), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    far = np.nan_to_num(np.maximum(t0, t1), nan=np.inf, posinf=np.inf, neginf=-np.inf)
    return near.max(axis=1).clip(0) <= far.min(axis=1)

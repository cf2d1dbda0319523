"""KITTI's point clouds: files of float32, four a point, in the LiDAR frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.ranges import LIDAR_HEIGHT
from lidarplace.clouds.clouds import STEP_M, Crop, PointClouds
from lidarplace.files.regular import is_there, regular
from lidarplace.scenes.kitti.calibration import LIDAR_HEIGHT_M
from lidarplace.scenes.kitti.read import fault, frame_name, subfolder

_BYTES = 16  # a point


def write_cloud(path: Path, points: NDArray[np.float32]) -> None:
    """Write the points of a frame, ego frame, shape (n, 4), float32."""
    moved = points.copy()
    moved[:, 2] -= np.float32(LIDAR_HEIGHT_M)
    path.write_bytes(moved.astype("<f4", copy=False).tobytes())


def read_kitti_clouds(
    folder: Path,
    frames: Sequence[int],
    crop: Crop,
    lidar_height: float = LIDAR_HEIGHT_M,
    skipped: list[str] | None = None,
) -> PointClouds:
    """Read `velodyne` files of a KITTI-format folder as clouds of one LiDAR in the ego frame.

    Args:
        folder: as for `read_kitti`.
        frames: numbers of the frames, that is, of their files.
        crop: x0, y0, z0, x1, y1, z1 in the ego frame, metres; points outside are left out.
        lidar_height: of the LiDAR above the ground, metres.
        skipped: gets what is wrong with points and files, which are then left out. Without it the
            first such fault is a ValueError."""
    LIDAR_HEIGHT.check("lidar_height", lidar_height)
    whole = {}
    for frame in frames:
        path = subfolder(folder, "velodyne") / f"{frame_name(frame)}.bin"
        if not is_there(path):
            fault(InputError("no such file", place=path), skipped)
        elif (size := regular(path).stat().st_size) % _BYTES:
            wanted = f"whole points of {_BYTES} bytes"
            fault(InputError(place=path, expected=wanted, found=f"{size} bytes"), skipped)
        else:
            whole[frame] = path
    low, high = np.reshape(crop, (2, 3))

    def read(path: Path) -> tuple[NDArray[np.float32], list[int]]:
        points = np.fromfile(regular(path), "<f4").reshape(-1, 4).astype(np.float32, copy=False)
        good = np.isfinite(points).all(axis=1) & (points[:, 3] >= 0) & (points[:, 3] <= 1)
        for index in np.flatnonzero(~good).tolist():
            place, expected = f"{path}: point {index}", "finite numbers, and an intensity in [0, 1]"
            error = InputError(place=place, expected=expected, found=points[index].tolist())
            fault(error, skipped)
        points = points[good]
        points[:, 2] += np.float32(lidar_height)
        # Adding the height rounds; what lay on a face of the region must stay in it.
        inside = (points[:, :3] >= low - STEP_M / 2) & (points[:, :3] <= high + STEP_M / 2)
        points = points[inside.all(axis=1)]
        points[:, :3] = np.clip(points[:, :3], low, high)
        return points, [len(points)]

    return PointClouds.from_frames(list(whole), map(read, whole.values()), crop)

"""KITTI's frames: places of LiDAR and camera, and the files that hold them.

LiDAR frame: x forward, y left, z up. Camera frame: x right, y down, z forward. Places on the
vehicle are those of Geiger et al., Vision meets Robotics, IJRR 2013; our camera looks ahead."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.regular import regular

LIDAR_HEIGHT_M = 1.73
"""The LiDAR frame's origin is so far above that of the ego frame; their axes are parallel."""
CAMERA_AHEAD_M = 0.27
CAMERA_BELOW_M = 0.08  # both: the camera, seen from the LiDAR
IMAGE_SIZE = (1242, 375)  # width and height of the image, pixels
FOCAL_PX = 721.5377
CENTRE_PX = (609.5593, 172.854)  # both: of most of KITTI's drives, without lens offsets
BASELINE_M = 0.54  # cameras 1 and 3 stand so far to the right of cameras 0 and 2


def _standard() -> dict[str, NDArray[np.float64]]:
    u, v = CENTRE_PX
    left = np.array([[FOCAL_PX, 0.0, u, 0.0], [0.0, FOCAL_PX, v, 0.0], [0.0, 0.0, 1.0, 0.0]])
    right = left.copy()
    right[0, 3] = -FOCAL_PX * BASELINE_M
    axes = [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, -CAMERA_BELOW_M], [1.0, 0, 0, -CAMERA_AHEAD_M]]
    imu = np.eye(3, 4)
    imu[2, 3] = -LIDAR_HEIGHT_M
    cameras = {"P0": left, "P1": right, "P2": left, "P3": right, "R0_rect": np.eye(3)}
    return cameras | {"Tr_velo_to_cam": np.array(axes), "Tr_imu_to_velo": imu}


STANDARD: Mapping[str, NDArray[np.float64]] = _standard()
"""Our calibration by KITTI's names, in the order of its files; the ego frame is the IMU's."""

# Names of the same matrices in KITTI's tracking layout.
_ALIASES = {"R_rect": "R0_rect", "Tr_velo_cam": "Tr_velo_to_cam"}
_SHAPES = {name: matrix.shape for name, matrix in STANDARD.items()}


def calibration_text(calibration: Mapping[str, NDArray[np.float64]] = STANDARD) -> str:
    """Write the content of a file in `calib`: a line a matrix, its name and its rows."""
    rows = {
        name: " ".join(f"{x:.12e}" for x in matrix.flat) for name, matrix in calibration.items()
    }
    return "".join(f"{name}: {row}\n" for name, row in rows.items())


def read_calibration(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read a file of `calib`: its matrices by name.

    Raises OSError, and ValueError if a line is not a matrix, or the camera has no pose."""
    matrices: dict[str, NDArray[np.float64]] = {}
    for number, line in enumerate(regular(path).read_text(errors="replace").splitlines(), start=1):
        key, *values = line.split() or [""]
        name = _ALIASES.get(key.rstrip(":"), key.rstrip(":"))
        if name not in _SHAPES:
            continue  # empty, or a time or size that some folders add
        shape = _SHAPES[name]
        try:
            matrix = np.array(values, np.float64)
        except ValueError:
            matrix = np.empty(0)
        if matrix.size != shape[0] * shape[1] or not np.isfinite(matrix).all():
            place, expected = f"{path}: line {number}", f"{shape[0] * shape[1]} finite numbers"
            raise InputError(place=place, key=name, expected=expected, found=repr(" ".join(values)))
        matrices[name] = matrix.reshape(shape)
    for name in ("R0_rect", "Tr_velo_to_cam"):
        if name not in matrices:
            raise InputError("missing line", place=path, key=name, found=[*matrices])
        turn = matrices[name][:, :3]
        within = np.abs(turn).max() < 2  # beyond, a product may overflow
        if not within or np.abs(turn @ turn.T - np.eye(3)).max() > 1e-2 or np.linalg.det(turn) < 0:
            raise InputError("not a rotation", place=path, key=name, found=turn.tolist())
    return matrices


def camera_to_ego(
    calibration: Mapping[str, NDArray[np.float64]] = STANDARD, lidar_height: float = LIDAR_HEIGHT_M
) -> NDArray[np.float64]:
    """Return the transform from the rectified camera frame, that of labels, to the ego frame.

    Shape (3, 4). `calibration` has `R0_rect` and `Tr_velo_to_cam`; `lidar_height` is in metres."""
    to_camera = np.eye(4)
    to_camera[:3] = calibration["R0_rect"] @ calibration["Tr_velo_to_cam"]
    to_ego = np.array(np.linalg.inv(to_camera)[:3], np.float64)
    to_ego[2, 3] += lidar_height
    return to_ego

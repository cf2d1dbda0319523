"""KITTI's labels of boxes: the camera frame, the image, and the text of a line."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.boxes import GEOMETRY
from lidarplace.scenes.kitti.calibration import (
    CAMERA_AHEAD_M,
    CAMERA_BELOW_M,
    CENTRE_PX,
    FOCAL_PX,
    IMAGE_SIZE,
    LIDAR_HEIGHT_M,
)

LABEL_COLUMNS = (
    *("class", "truncated", "occluded", "alpha", "left", "top", "right", "bottom"),
    *("height", "width", "length", "x", "y", "z", "rotation_y"),
)
"""The fields of a line, in its order. x, y, z: centre of the bottom, camera frame."""
DECIMALS = 2
NEAR_M = 0.1  # what is nearer to the plane of the camera is not in the image
_LINE = "%s %.2f %d" + 12 * " %.2f"


def to_labels(objects: pd.DataFrame) -> pd.DataFrame:
    """Compute labels of boxes: `frame` and `LABEL_COLUMNS`, a row for every row of `objects`.

    Numbers are rounded to KITTI's two decimals first; the image box, `truncated` and `alpha` belong
    to the rounded box. The image box is that of the eight corners, cut to the image; `truncated` is
    the share of its area that the cut takes off. An object that the image does not show has
    `truncated` 1 and an image box of zeros.

    Args:
        objects: `frame`, `class`, `occluded` (0 to 3) and the columns of `GEOMETRY`, ego frame."""
    ego = dict(zip(GEOMETRY, objects[list(GEOMETRY)].to_numpy(np.float64).T, strict=True))
    bottom = ego["z"] - 0.5 * ego["height"]
    height, width, length = (_rounded(ego[name]) for name in ("height", "width", "length"))
    x = _rounded(-ego["y"])
    y = _rounded(LIDAR_HEIGHT_M - CAMERA_BELOW_M - bottom)
    z = _rounded(ego["x"] - CAMERA_AHEAD_M)
    rotation_y = _rounded(_wrapped(-ego["yaw"] - 0.5 * np.pi))
    box = (height, width, length, x, y, z, rotation_y)
    whole = _image_boxes(*box)
    right, lower = (size - 1.0 for size in IMAGE_SIZE)
    cut = _rounded(np.clip(whole, 0.0, [right, lower, right, lower]))
    visible = (cut[:, 2:] > cut[:, :2]).all(axis=1)
    cut[~visible] = 0.0
    area, cut_area = ((sides[:, 2:] - sides[:, :2]).prod(axis=1) for sides in (whole, cut))
    share = np.divide(cut_area, area, out=np.zeros_like(area), where=visible)
    truncated = _rounded(np.clip(1.0 - share, 0.0, 1.0))
    alpha = _rounded(_wrapped(rotation_y - np.arctan2(x, z)))
    occluded = objects["occluded"].to_numpy(np.int64)
    columns = (objects["class"].to_numpy(), truncated, occluded, alpha, *cut.T, *box)
    labels = dict(zip(LABEL_COLUMNS, columns, strict=True))
    return pd.DataFrame({"frame": objects["frame"].to_numpy(np.int64), **labels})


def in_image(labels: pd.DataFrame) -> NDArray[np.bool_]:
    """Return a mask of the objects that the image shows, if only in part; shape (rows,)."""
    return (labels["right"] > labels["left"]).to_numpy()


def label_lines(labels: pd.DataFrame) -> list[str]:
    """Format the rows as lines of a file."""
    columns = (labels[name].tolist() for name in LABEL_COLUMNS)
    return [_LINE % fields for fields in zip(*columns, strict=True)]


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round to KITTI's decimals, without negative zero."""
    return np.round(values, DECIMALS) + 0.0


def _wrapped(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn angles into [-pi, pi)."""
    return np.mod(angle + np.pi, 2 * np.pi) - np.pi


def _image_boxes(*box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return left, top, right, bottom of boxes in an image without end, (N, 4); zeros if none.

    Box and camera are upright, so the part of a box before the camera stands on the part of its
    footprint there: at most four corners and two points where edges pass `NEAR_M`."""
    height, width, length, x, y, z, rotation_y = box
    along = 0.5 * length[:, None] * [1.0, 1.0, -1.0, -1.0]
    across = 0.5 * width[:, None] * [1.0, -1.0, -1.0, 1.0]
    cos, sin = np.cos(rotation_y)[:, None], np.sin(rotation_y)[:, None]
    right = x[:, None] + cos * along + sin * across
    depth = z[:, None] - sin * along + cos * across
    next_right, next_depth = np.roll(right, -1, axis=1), np.roll(depth, -1, axis=1)
    passes = (depth < NEAR_M) != (next_depth < NEAR_M)
    step = np.divide(NEAR_M - depth, next_depth - depth, out=np.zeros_like(depth), where=passes)
    right = np.concatenate([right, right + step * (next_right - right)], axis=1)
    before = np.concatenate([depth >= NEAR_M, passes], axis=1)
    depth = np.where(before, np.concatenate([depth, np.full_like(depth, NEAR_M)], axis=1), 1.0)
    u = CENTRE_PX[0] + FOCAL_PX * right / depth
    low = CENTRE_PX[1] + FOCAL_PX * y[:, None] / depth
    high = CENTRE_PX[1] + FOCAL_PX * (y - height)[:, None] / depth
    least = [np.where(before, side, np.inf).min(axis=1) for side in (u, high)]
    most = [np.where(before, side, -np.inf).max(axis=1) for side in (u, low)]
    boxes = np.stack([*least, *most], axis=1)
    boxes[~before.any(axis=1)] = 0.0
    return boxes

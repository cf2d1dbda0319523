"""KITTI's labels: boxes in the camera frame, and what counts at which difficulty."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.columns import check_columns
from lidarplace.logs.plausibility import check_yaw
from lidarplace.scenes.kitti.labels import LABEL_COLUMNS
from training.average_precision import COUNTS, IGNORED, OTHER, FramePairs

# Easy, moderate, hard: the limits of KITTI's development kit.
DIFFICULTIES = ("easy", "moderate", "hard")
_MIN_HEIGHT = (40.0, 25.0, 25.0)
_MAX_OCCLUSION = (0, 1, 2)
_MAX_TRUNCATION = (0.15, 0.3, 0.5)
# Look like the class, so finding them is no false alarm.
_NEIGHBOURS = {"car": "van", "pedestrian": "person_sitting"}
UNKNOWN_ALPHA = -10.0
"""What KITTI writes for the observation angle of a detection without orientation."""
_IMAGE_BOX = ("left", "top", "right", "bottom")


def checked_labels(table: pd.DataFrame, source: str, more: tuple[str, ...]) -> pd.DataFrame:
    """The table itself; ValueError if a column is missing, or a rotation_y is over two turns.

    Also if a number of `more` is not finite, or one of another column but for `DontCare`.
    """
    check_columns(list(table.columns), ("frame", *LABEL_COLUMNS, *more), source)
    of_label = table[["frame", *(name for name in LABEL_COLUMNS if name != "class")]]
    regions = table["class"].str.lower().to_numpy(str) == "dontcare"
    bad = ~np.isfinite(of_label.to_numpy(np.float64)).all(axis=1) & ~regions
    bad |= ~np.isfinite(table[list(more)].to_numpy(np.float64)).all(axis=1)
    if bad.any():
        raise InputError(place=f"{source}: row {np.argmax(bad)}", expected="finite numbers")
    check_yaw(table["rotation_y"], source)
    return table


def boxes_z_up(labels: pd.DataFrame) -> NDArray[np.float64]:
    """Boxes (N, 7) in the camera's place with x forward, y left, z up; (0, …, 0) for DontCare.

    Camera frame: x right, y down, z forward, origin of a box at the centre of its bottom.
    """
    columns = ("x", "y", "z", "length", "width", "height", "rotation_y")
    x, y, z, length, width, height, yaw = labels[list(columns)].to_numpy(np.float64).T
    sides = [length, width, height, -yaw - 0.5 * np.pi]
    boxes = np.stack([z, -x, 0.5 * height - y, *sides], axis=1)
    boxes[labels["class"].str.lower().to_numpy(str) == "dontcare"] = 0.0
    return boxes


def _image_boxes(labels: pd.DataFrame) -> NDArray[np.float64]:
    return labels[list(_IMAGE_BOX)].to_numpy(np.float64)


def _image_intersection(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Common area of row i of `a` and of `b`: (P, 4) left, top, right, bottom; px²."""
    sides = np.minimum(a[:, 2:], b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    return np.where((sides > 0).all(axis=1), sides.prod(axis=1), 0.0)


def image_iou(truths: pd.DataFrame, found: pd.DataFrame, pairs: FramePairs) -> NDArray[np.float64]:
    """IoU in the image of every pair, shape (P,)."""
    a, b = _image_boxes(truths)[pairs.ground_truth], _image_boxes(found)[pairs.detection]
    common = _image_intersection(a, b)
    union = (a[:, 2:] - a[:, :2]).prod(axis=1) + (b[:, 2:] - b[:, :2]).prod(axis=1) - common
    return np.asarray(np.divide(common, union, out=np.zeros_like(common), where=common > 0))


def orientation_similarity(
    truths: pd.DataFrame, found: pd.DataFrame, pairs: FramePairs
) -> NDArray[np.float64]:
    """(1 + cos of the difference of the observation angles) / 2 of every pair, shape (P,)."""
    a, b = (table["alpha"].to_numpy(np.float64) for table in (truths, found))
    return np.asarray(0.5 * (1 + np.cos(a[pairs.ground_truth] - b[pairs.detection])))


def covered_by_dont_care(
    truths: pd.DataFrame, found: pd.DataFrame, pairs: FramePairs, regions: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Largest share of each detection's image box within one DontCare region, shape (D,)."""
    inside = regions[pairs.ground_truth]
    detection = pairs.detection[inside]
    a = _image_boxes(truths)[pairs.ground_truth[inside]]
    b = _image_boxes(found)[detection]
    common = _image_intersection(a, b)
    area = (b[:, 2:] - b[:, :2]).prod(axis=1)
    part = np.divide(common, area, out=np.zeros_like(common), where=common > 0)
    share = np.zeros(len(found))
    np.maximum.at(share, detection, part)
    return share


def ground_truth_role(
    truths: pd.DataFrame, names: NDArray[np.str_], name: str, level: int, min_height: bool
) -> NDArray[np.int8]:
    """COUNTS, IGNORED or OTHER for every label with `names` in lower case, shape (G,), int8.

    To the class `name` at `level` in DIFFICULTIES; with `min_height` low labels are ignored.
    """
    height = truths["bottom"].to_numpy(np.float64) - truths["top"].to_numpy(np.float64)
    hard = truths["occluded"].to_numpy(np.float64) > _MAX_OCCLUSION[level]
    hard |= truths["truncated"].to_numpy(np.float64) > _MAX_TRUNCATION[level]
    if min_height:
        hard |= height <= _MIN_HEIGHT[level]
    own = names == name.lower()
    neighbour = names == _NEIGHBOURS.get(name.lower(), "")
    role = np.where(own & ~hard, COUNTS, np.where(own | neighbour, IGNORED, OTHER))
    return role.astype(np.int8)


def detection_role(
    found: pd.DataFrame, names: NDArray[np.str_], name: str, level: int, min_height: bool
) -> NDArray[np.int8]:
    """COUNTS, IGNORED or OTHER for every detection, shape (D,), int8; see `ground_truth_role`."""
    role = np.where(names == name.lower(), COUNTS, OTHER)
    if min_height:
        height = np.abs(found["bottom"].to_numpy(np.float64) - found["top"].to_numpy(np.float64))
        # Before the class is looked at: a low detection of any class can be taken and not count.
        role = np.where(height < _MIN_HEIGHT[level], IGNORED, role)
    return role.astype(np.int8)

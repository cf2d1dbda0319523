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


def checked_labels(table: pd.DataFrame, source: str, more: tuple[str, ...]) -> pd.DataFrame:
    """Return the table with classes in lower case; ValueError if a column is missing.

    Also if a rotation_y is over two turns, a number of `more` is not finite, or one of another
    column but for `DontCare`."""
    check_columns(list(table.columns), ("frame", *LABEL_COLUMNS, *more), source)
    table = table.assign(**{"class": table["class"].str.lower()})
    of_label = table[["frame", *(name for name in LABEL_COLUMNS if name != "class")]]
    bad = ~np.isfinite(of_label.to_numpy(np.float64)).all(axis=1) & ~_has_class(table, "dontcare")
    bad |= ~np.isfinite(table[list(more)].to_numpy(np.float64)).all(axis=1)
    if bad.any():
        raise InputError(place=f"{source}: row {np.argmax(bad)}", expected="finite numbers")
    check_yaw(table["rotation_y"], source)
    return table


def boxes_z_up(labels: pd.DataFrame) -> NDArray[np.float64]:
    """Boxes (N, 7) in the camera's place with x forward, y left, z up; (0, …, 0) for DontCare.

    Camera frame: x right, y down, z forward, origin of a box at the centre of its bottom."""
    columns = ("x", "y", "z", "length", "width", "height", "rotation_y")
    x, y, z, length, width, height, yaw = labels[list(columns)].to_numpy(np.float64).T
    sides = [length, width, height, -yaw - 0.5 * np.pi]
    boxes = np.stack([z, -x, 0.5 * height - y, *sides], axis=1)
    boxes[_has_class(labels, "dontcare")] = 0.0
    return boxes


def _has_class(labels: pd.DataFrame, name: str) -> NDArray[np.bool_]:
    return np.asarray(labels["class"].to_numpy(object) == name.lower())


def _image_boxes(labels: pd.DataFrame, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    return labels[["left", "top", "right", "bottom"]].to_numpy(np.float64)[rows]


def _image_intersection(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Common area of row i of `a` and of `b`: (P, 4) left, top, right, bottom; px²."""
    sides = np.minimum(a[:, 2:], b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    return np.where((sides > 0).all(axis=1), sides.prod(axis=1), 0.0)


def image_iou(
    truths: pd.DataFrame, detected: pd.DataFrame, pairs: FramePairs
) -> NDArray[np.float64]:
    """IoU in the image of every pair, shape (P,)."""
    a, b = _image_boxes(truths, pairs.ground_truth), _image_boxes(detected, pairs.detection)
    common = _image_intersection(a, b)
    union = (a[:, 2:] - a[:, :2]).prod(axis=1) + (b[:, 2:] - b[:, :2]).prod(axis=1) - common
    return np.asarray(np.divide(common, union, out=np.zeros_like(common), where=common > 0))


def orientation_similarity(
    truths: pd.DataFrame, detected: pd.DataFrame, pairs: FramePairs
) -> NDArray[np.float64]:
    """(1 + cos of the difference of the observation angles) / 2 of every pair, shape (P,)."""
    a, b = (table["alpha"].to_numpy(np.float64) for table in (truths, detected))
    return np.asarray(0.5 * (1 + np.cos(a[pairs.ground_truth] - b[pairs.detection])))


def covered_by_dont_care(
    truths: pd.DataFrame, detected: pd.DataFrame, pairs: FramePairs
) -> NDArray[np.float64]:
    """Largest share of each detection's image box within one DontCare region, shape (D,)."""
    in_region = _has_class(truths, "dontcare")[pairs.ground_truth]
    region, detection = pairs.ground_truth[in_region], pairs.detection[in_region]
    boxes = _image_boxes(detected, detection)
    common = _image_intersection(_image_boxes(truths, region), boxes)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    part = np.divide(common, area, out=np.zeros_like(common), where=common > 0)
    share = np.zeros(len(detected))
    np.maximum.at(share, detection, part)
    return share


def ground_truth_role(
    truths: pd.DataFrame, name: str, level: int, min_height: bool
) -> NDArray[np.int8]:
    """Role of every label for class `name` at `level` in DIFFICULTIES, shape (G,), int8.

    COUNTS, IGNORED or OTHER; with `min_height` low labels are ignored."""
    height = truths["bottom"].to_numpy(np.float64) - truths["top"].to_numpy(np.float64)
    hard = truths["occluded"].to_numpy(np.float64) > _MAX_OCCLUSION[level]
    hard |= truths["truncated"].to_numpy(np.float64) > _MAX_TRUNCATION[level]
    if min_height:
        hard |= height <= _MIN_HEIGHT[level]
    of_class = _has_class(truths, name)
    neighbour = _has_class(truths, _NEIGHBOURS.get(name.lower(), ""))
    role = np.where(of_class & ~hard, COUNTS, np.where(of_class | neighbour, IGNORED, OTHER))
    return role.astype(np.int8)


def detection_role(
    detected: pd.DataFrame, name: str, level: int, min_height: bool
) -> NDArray[np.int8]:
    """Role of every detection, shape (D,), int8; see `ground_truth_role`."""
    role = np.where(_has_class(detected, name), COUNTS, OTHER)
    if min_height:
        height = np.abs(
            detected["bottom"].to_numpy(np.float64) - detected["top"].to_numpy(np.float64)
        )
        # Before the class is looked at: a low detection of any class can be taken and not count.
        role = np.where(height < _MIN_HEIGHT[level], IGNORED, role)
    return role.astype(np.int8)

"""Other conventions of axes, angles, units and frames, under which detections may fit the labels.

From above first, where the height decides nothing; then the height."""

import math
from collections.abc import Collection, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.logs.boxes import GEOMETRY, POSE_COLUMNS, full_poses
from lidarplace.logs.plausibility import DetectionCheck, ImplausibleValue
from lidarplace.scenes.datasets.se3 import Poses
from lidarplace.scenes.sanity_checks.boxes import FARTHEST_M
from training.sanity_checks.sample import Boxes, Sample

LEAST = 10
"""Labels that must fit better under another convention."""
FITS, DIFFERS = 0.4, 0.2
"""Least IoU of a label under one of two conventions, and difference of both, that tells them apart.
"""
MANY = 4
"""So many times more labels fit better than worse."""
BIASES: Collection[DetectionCheck] = ("size", "ground", "time")
BETTER = 1.8
"""What a detector may be off by, and so many times larger is their median IoU where it is more."""
ENOUGH = 20
"""Detections and labels of which at least one should overlap another."""
SAME_PLACE = 0.5
"""IoU from above of a label and a detection whose heights are compared."""

_PLACES = {
    "": ((1, 0), (0, 1)),
    "y mirrored": ((1, 0), (0, -1)),
    "x mirrored": ((-1, 0), (0, 1)),
    "x and y swapped": ((0, 1), (1, 0)),
    "x and y turned by 180 degrees": ((-1, 0), (0, -1)),
    "x and y turned by 90 degrees": ((0, -1), (1, 0)),
    "x and y turned by -90 degrees": ((0, 1), (-1, 0)),
    "x and y swapped and mirrored": ((0, -1), (-1, 0)),
}
_YAWS = {
    "": (1, 0.0),
    "yaw mirrored": (-1, 0.0),
    "yaw turned by 90 degrees, or length and width swapped": (1, math.pi / 2),
    "yaw as 90 degrees less yaw": (-1, math.pi / 2),
}
_UNITS = {"millimetres": 1e-3, "centimetres": 1e-2}


class Convention(NamedTuple):
    """Detections as they would be meant."""

    check: DetectionCheck
    column: str
    text: str
    boxes: Boxes
    frame: NDArray[np.int64]  # its place in `Sample.frames`, -1 for none


def implausible_conventions(sample: Sample) -> Iterator[ImplausibleValue]:
    """Check the convention of the boxes; that of the height only if they fit from above."""
    chosen = sample.chosen_detections()
    boxes = sample.detections[list(GEOMETRY)].to_numpy(np.float64)[chosen]
    original = Convention("place", "x", "", boxes, sample.frame[chosen])
    from_above = sample.largest(sample.overlaps(boxes, original.frame, three_d=False))
    value = _fitting(sample, from_above, _from_above(sample, original), three_d=False)
    if value is None and len(boxes) and np.median(np.hypot(*boxes[:, :2].T)) > FARTHEST_M:
        problem = f"most detections are farther than {FARTHEST_M:,.0f} m from the vehicle"
        remedy = "convert them to metres in the vehicle's frame"
        value = ImplausibleValue("place", "x", problem, remedy, certain=True)
    elif value is None and not from_above.any():
        if min(len(boxes), len(from_above)) < ENOUGH:
            return
        problem = (
            f"none of {len(boxes):,} detections in {len(sample.chosen):,} frames overlaps an object"
        )
        remedy = "look for another frame of coordinates"
        value = ImplausibleValue("overlap", "x", problem, remedy, certain=False)
    elif value is None:
        whole = sample.largest(sample.overlaps(boxes, original.frame, three_d=True))
        value = _fitting(sample, whole, _heights(sample, original), three_d=True)
    yield from () if value is None else (value,)


def _fitting(
    sample: Sample, before: NDArray[np.float64], others: Iterator[Convention], three_d: bool
) -> ImplausibleValue | None:
    """Name the convention that fits best, the first of equals; None if none is far better.

    `before` is the largest IoU of each label in the original one."""
    most, value = 0.0, None
    for other in others:
        after = sample.largest(sample.overlaps(other.boxes, other.frame, three_d))
        if (total := float(after.sum())) <= 1.02 * most:
            continue
        telling = (np.maximum(before, after) > FITS) & (np.abs(after - before) > DIFFERS)
        better = int((after > before)[telling].sum())
        if better < max(LEAST, MANY * (telling.sum() - better)):
            continue
        medians = float(np.median(before[telling])), float(np.median(after[telling]))
        if other.check in BIASES and medians[1] < BETTER * medians[0]:
            continue
        problem = (
            f"detections fit the labels {other.text}: median IoU {medians[1]:.2f} instead of "
            f"{medians[0]:.2f}, of {telling.sum():,} objects in {len(sample.chosen):,} frames"
        )
        value = ImplausibleValue(other.check, other.column, problem, "convert them", certain=True)
        most = total
    return value


def _from_above(sample: Sample, original: Convention) -> Iterator[Convention]:
    """The simpler ones first."""
    boxes = original.boxes
    turns = [*product(_PLACES.items(), _YAWS.items())][1:]
    for (place, axes), (yaw, (sign, turn)) in sorted(turns, key=lambda pair: bool(pair[1][0])):
        other = boxes.copy()
        other[:, :2] = boxes[:, :2] @ np.transpose(axes)
        other[:, 6] = sign * boxes[:, 6] + turn
        text = "with " + " and ".join(filter(None, (place, yaw)))
        check: DetectionCheck = "place" if place else "yaw"
        yield Convention(check, place[:1] or "yaw", text, other, original.frame)
    for unit, factor in _UNITS.items():
        yield _scaled(original, "place", f"with places and sizes in {unit}", factor, factor)
        yield _scaled(original, "place", f"with places in {unit}", factor, 1.0)
        yield _scaled(original, "size", f"with sizes in {unit}", 1.0, factor)
    yield _scaled(original, "size", "with sizes as half of an object", 1.0, 2.0)
    yield _scaled(original, "size", "with sizes as twice an object", 1.0, 0.5)
    every = sample.detections[list(GEOMETRY)].to_numpy(np.float64)
    for text, frame in _frames(sample):
        yield Convention("time", "frame", text, every, frame)
    poses = full_poses(sample.frames) if set(POSE_COLUMNS) <= {*sample.frames} else {}
    detections = sample.detections[sample.chosen_detections()]
    numbers = detections["frame"].tolist()
    if numbers and poses.keys() >= set(numbers):
        turned, origin = zip(*(poses[number] for number in numbers), strict=True)
        ego = Poses(np.array(origin), Rotation.from_matrix(np.array(turned)))
        poses_of_boxes = Poses.of_boxes(detections)
        for text, posed in (
            ("as boxes in the world", poses_of_boxes.seen_from(ego)),
            ("as boxes in the vehicle's frame, not in the world", poses_of_boxes.posed_by(ego)),
        ):
            other = np.column_stack([posed.position, boxes[:, 3:6], posed.yaw])
            yield original._replace(text=text, boxes=other)


def _scaled(
    original: Convention, check: DetectionCheck, text: str, place: float, size: float
) -> Convention:
    boxes = original.boxes * [*[place] * 3, *[size] * 3, 1.0]
    return Convention(check, "x" if check == "place" else "length", text, boxes, original.frame)


def _frames(sample: Sample) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """The frame of each detection, were frames miscounted."""
    place = np.arange(len(sample.frames))
    of_scene = pd.Series(place).groupby(sample.frames["scene"].to_numpy())
    for text, step in (("of the next frame", -1), ("of the frame before", 1)):
        yield text, of_scene.shift(step, fill_value=-1).to_numpy(np.int64)[sample.frame]
    ends = (of_scene.transform(end).to_numpy(np.int64) for end in ("min", "max"))
    yield "with the frames of each scene reversed", (sum(ends) - place)[sample.frame]
    yield "with all frames reversed", place[::-1][sample.frame]


def _heights(sample: Sample, original: Convention) -> Iterator[Convention]:
    """Another origin of z: the bottom of a box, or one that is as far off as the boxes are."""
    label, row, iou = sample.overlaps(original.boxes, original.frame, three_d=False)
    same = iou > SAME_PLACE
    up = sample.labels["z"].to_numpy(np.float64)[label[same]] - original.boxes[row[same], 2]
    off = float(np.median(up)) if len(up) else 0.0
    for text, offset in (
        ("with z at the bottom of a box", original.boxes[:, 5] / 2),
        (f"with z {off:+.2f} m from its value, as from a LiDAR", off),
    ):
        boxes = original.boxes.copy()
        boxes[:, 2] += offset
        yield Convention("ground", "z", text, boxes, original.frame)

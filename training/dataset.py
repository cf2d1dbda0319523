"""The frames of a training: points, boxes and labels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.clouds.clouds import Clouds
from lidarplace.clouds.points_in_boxes import count_points
from lidarplace.logs.boxes import GEOMETRY, check_boxes


@dataclass(frozen=True)
class Sample:
    """One frame: points (N, 4) and boxes (M, 7), float32, and labels (M,) from 1, int64."""

    points: NDArray[np.float32]
    boxes: NDArray[np.float32]
    labels: NDArray[np.int64]


class TrainingFrames:
    """Frames of `clouds` with their objects, in a detector's frame, `sensor_height` metres up.

    Points stay packed; one frame at a time is unpacked. Frame numbers may repeat, as they do in the
    clouds of several placements. Objects of other `classes` than these, labels 1, 2, …, and with
    fewer than `min_points` are left out, frames by `share` as in `spread`; clouds and ground truth
    (frame, class, x, y, z, length, width, height, yaw) are in the ego frame.

    Attributes:
        numbers: frame numbers, shape (F,), int64.
        all_objects: number of objects of the classes in these frames, with too few points, too;
            the same for every rig.
        objects: which of them the boxes of each frame are, shapes (M,).

    Raises ValueError if `ground_truth` lacks a column or has a number that is not finite."""

    def __init__(
        self,
        classes: Sequence[str],
        clouds: Clouds,
        ground_truth: pd.DataFrame,
        sensor_height: float,
        min_points: int,
        share: float = 1.0,
    ) -> None:
        check_boxes(ground_truth, "ground truth")
        self._clouds = clouds
        self._lift = np.float32(sensor_height)
        self._rows = spread(len(clouds), share)
        self.numbers = clouds.frames[self._rows]
        objects = ground_truth[
            ground_truth["class"].isin(list(classes)) & ground_truth["frame"].isin(self.numbers)
        ].sort_values("frame", kind="stable")
        frame = objects["frame"].to_numpy(np.int64)
        boxes = objects[list(GEOMETRY)].to_numpy(np.float64)
        labels = 1 + pd.Index(list(classes)).get_indexer(pd.Index(objects["class"]))
        self.all_objects = len(objects)
        points = np.zeros(len(self), np.int64)
        self.objects: list[NDArray[np.int64]] = []
        self._boxes: list[NDArray[np.float32]] = []
        self._labels: list[NDArray[np.int64]] = []
        for index, number in enumerate(self.numbers):
            low, high = np.searchsorted(frame, [number, number + 1])
            cloud = clouds[self._rows[index]]
            points[index] = len(cloud)
            seen = count_points(cloud, boxes[low:high]) >= min_points
            seen_boxes = boxes[low:high][seen]
            seen_boxes[:, 2] -= sensor_height
            self.objects.append(low + np.flatnonzero(seen))
            self._boxes.append(seen_boxes.astype(np.float32))
            self._labels.append(labels[low:high][seen].astype(np.int64))
        self._by_size = np.argsort(-points, kind="stable")

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> Sample:
        """Unpack the `index`-th frame; the caller may change its arrays."""
        points = self._clouds[self._rows[index]]
        points[:, 2] -= self._lift
        return Sample(points, self._boxes[index].copy(), self._labels[index].copy())

    def largest(self, count: int) -> list[Sample]:
        """Unpack the `count` frames with most points; fewer frames start again from the first."""
        return [self[index] for index in np.resize(self._by_size, count).tolist()]


def spread(frames: int, share: float) -> NDArray[np.int64]:
    """Choose `share` of `frames` rows, at least one, at even distances from the first on."""
    chosen = min(frames, max(1, round(share * frames)))
    return np.arange(chosen) * frames // max(1, chosen)


def occurring_classes(
    classes: Sequence[str], clouds: Clouds, ground_truth: pd.DataFrame, share: float = 1.0
) -> tuple[str, ...]:
    """Select the classes that have an object in the frames that are trained on; all if none has.

    A detector needs neither anchors nor heads for the others: it could not learn them."""
    numbers = clouds.frames[spread(len(clouds), share)]
    occurring = set(ground_truth.loc[ground_truth["frame"].isin(numbers), "class"])
    return tuple(name for name in classes if name in occurring) or tuple(classes)


def as_tensors(samples: Sequence[Sample]) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Convert samples to points, boxes and labels of a batch, as `Detector.loss` takes them."""
    points, boxes, labels = (
        [torch.from_numpy(getattr(item, name)) for item in samples]
        for name in ("points", "boxes", "labels")
    )
    return points, boxes, labels

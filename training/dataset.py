"""Frames of points, boxes and labels for training, and their random augmentation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.boxes import GEOMETRY, check_boxes
from lidarplace.lidar.clouds import Clouds
from lidarplace.lidar.points_in_boxes import count_points
from training.detectors.detector import PointRange
from training.settings import TrainingSettings


@dataclass(frozen=True)
class Sample:
    """One frame: points (N, 4) and boxes (M, 7), float32, and labels (M,) from 1, int64."""

    points: NDArray[np.float32]
    boxes: NDArray[np.float32]
    labels: NDArray[np.int64]


class TrainingFrames:
    """The frames of `clouds` with their objects, in the frame of a detector.

    Points stay packed; one frame at a time is unpacked.

    Args:
        classes: labels 1, 2, …; objects of other classes are left out.
        clouds: points, ego frame.
        ground_truth: columns frame, class, x, y, z, length, width, height, yaw, ego frame.
        sensor_height: height of the detector's origin above the ground, metres.
        min_points: objects with fewer points are left out.

    Raises:
        ValueError: `ground_truth` lacks a column or has a number that is not finite.
    """

    def __init__(
        self,
        classes: Sequence[str],
        clouds: Clouds,
        ground_truth: pd.DataFrame,
        sensor_height: float,
        min_points: int,
    ) -> None:
        check_boxes(ground_truth, "ground truth")
        self._clouds = clouds
        self._lift = np.array([0, 0, sensor_height, 0], np.float32)
        own = ground_truth[
            ground_truth["class"].isin(list(classes)) & ground_truth["frame"].isin(clouds.frames)
        ].sort_values("frame", kind="stable")
        frame = own["frame"].to_numpy(np.int64)
        boxes = own[list(GEOMETRY)].to_numpy(np.float64)
        labels = 1 + pd.Index(list(classes)).get_indexer(pd.Index(own["class"]))
        self._boxes: list[NDArray[np.float32]] = []
        self._labels: list[NDArray[np.int64]] = []
        for index, number in enumerate(clouds.frames):
            low, high = np.searchsorted(frame, [number, number + 1])
            seen = count_points(clouds[index], boxes[low:high]) >= min_points
            kept = boxes[low:high][seen]
            kept[:, 2] -= sensor_height
            self._boxes.append(kept.astype(np.float32))
            self._labels.append(labels[low:high][seen].astype(np.int64))

    def __len__(self) -> int:
        return len(self._clouds)

    def __getitem__(self, index: int) -> Sample:
        return Sample(
            self._clouds[index] - self._lift, self._boxes[index].copy(), self._labels[index]
        )


def augment(sample: Sample, settings: TrainingSettings, random: np.random.Generator) -> Sample:
    """Mirror, turn and scale a frame at random, as OpenPCDet does for KITTI.

    The points and boxes of `sample` are changed in place.
    """
    points, boxes = sample.points, sample.boxes
    if settings.flip_y and random.random() < 0.5:
        points[:, 1] *= -1
        boxes[:, 1] *= -1
        boxes[:, 6] *= -1
    angle = random.uniform(-settings.rotation, settings.rotation)
    turn = np.array(
        [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]], np.float32
    )
    points[:, :2] = points[:, :2] @ turn
    boxes[:, :2] = boxes[:, :2] @ turn
    boxes[:, 6] += angle
    scale = random.uniform(*settings.scaling)
    points[:, :3] *= scale
    boxes[:, :6] *= scale
    return sample


def within_range(sample: Sample, point_range: PointRange) -> Sample:
    """The points in `point_range` and the boxes whose centre lies in it, seen from above."""
    low, high = np.array(point_range[:3]), np.array(point_range[3:])
    points = sample.points
    inside = ((points[:, :3] >= low) & (points[:, :3] <= high)).all(axis=1)
    centres = sample.boxes[:, :2]
    kept = ((centres >= low[:2]) & (centres <= high[:2])).all(axis=1)
    return Sample(points[inside], sample.boxes[kept], sample.labels[kept])


def as_tensors(samples: Sequence[Sample]) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Points, boxes and labels of a batch, as `Detector.loss` takes them."""
    return (
        [torch.from_numpy(item.points) for item in samples],
        [torch.from_numpy(item.boxes) for item in samples],
        [torch.from_numpy(item.labels) for item in samples],
    )

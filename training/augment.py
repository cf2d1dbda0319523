"""Random changes to a training frame: OpenPCDet's for KITTI, in its order."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from training.dataset import Sample
from training.detectors.detector import PointRange
from training.ground_truth_sampling import ObjectDatabase
from training.randomness import Purpose, generator
from training.settings import TrainingSettings


@dataclass(frozen=True)
class Augmentation:
    """Paste objects, mirror, turn, scale, cut to the range, shuffle the points.

    Attributes:
        settings: which of it, and how much.
        point_range: of the detector, in its frame.
        database: objects to paste.
    """

    settings: TrainingSettings
    point_range: PointRange
    database: ObjectDatabase

    def __call__(self, sample: Sample, key: tuple[int, int, int]) -> Sample:
        """A frame as it is trained on. The arrays of `sample` may be changed.

        All randomness follows from `key`: seed, epoch and frame.
        """
        sample = self.database.paste(sample, generator(Purpose.PASTE, *key))
        sample = moved(sample, self.settings, generator(Purpose.MOVE, *key))
        sample = within_range(sample, self.point_range)
        # A detector that takes so many points of a voxel, or voxels of a frame, takes the first.
        order = generator(Purpose.SHUFFLE, *key).permutation(len(sample.points))
        return Sample(sample.points[order], sample.boxes, sample.labels)


def moved(sample: Sample, settings: TrainingSettings, random: np.random.Generator) -> Sample:
    """Mirror, turn and scale a frame. The points and boxes of `sample` are changed in place."""
    points, boxes = sample.points, sample.boxes
    mirrored = random.random() < 0.5  # drawn in any case: turns and scales stay what they are
    if settings.flip_y and mirrored:
        points[:, 1] *= -1
        boxes[:, 1] *= -1
        boxes[:, 6] *= -1
    angle = random.uniform(-settings.rotation, settings.rotation)
    cos, sin = np.float32(math.cos(angle)), np.float32(math.sin(angle))
    for rows in (points, boxes):  # no matrix product, which rounds otherwise on another processor
        x, y = rows[:, 0].copy(), rows[:, 1].copy()
        rows[:, 0], rows[:, 1] = x * cos - y * sin, x * sin + y * cos
    boxes[:, 6] += angle
    boxes[:, 6] -= 2 * math.pi * np.floor(boxes[:, 6] / (2 * math.pi) + 0.5)
    scale = random.uniform(*settings.scaling)
    points[:, :3] *= scale
    boxes[:, :6] *= scale
    return sample


def within_range(sample: Sample, point_range: PointRange) -> Sample:
    """The points and the boxes' centres in `point_range` as seen from above, at any height."""
    # In the points' own precision, which spares a copy of them in double.
    low, high = np.array(point_range, np.float32).reshape(2, 3)[:, :2]

    def inside(rows: NDArray[np.float32]) -> NDArray[np.bool_]:
        return np.asarray(((rows[:, :2] >= low) & (rows[:, :2] <= high)).all(axis=1))

    kept = inside(sample.boxes)
    return Sample(sample.points[inside(sample.points)], sample.boxes[kept], sample.labels[kept])

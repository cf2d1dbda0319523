"""Random changes to a training frame: OpenPCDet's for KITTI, in its order."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from training.dataset import Sample
from training.detectors.detector import PointRange
from training.ground_truth_sampling import ObjectDatabase
from training.randomness import Purpose, generator
from training.settings import TrainingSettings


@dataclass(frozen=True)
class Augmentation:
    """Paste objects, mirror, turn, scale, cut to the range, shuffle the points."""

    settings: TrainingSettings  # which of it, and how much
    point_range: PointRange  # of the detector, in its frame
    database: ObjectDatabase  # objects to paste

    def __call__(self, sample: Sample, key: tuple[int, int, int]) -> Sample:
        """Change a frame at random by `key`: seed, epoch, frame; may write to `sample`."""
        sample = self.database.paste(sample, generator(Purpose.PASTE, *key))
        sample = moved(sample, self.settings, generator(Purpose.MOVE, *key))
        sample = within_range(sample, self.point_range)
        # A detector that takes so many points of a voxel, or voxels of a frame, takes the first.
        order = generator(Purpose.SHUFFLE, *key).permutation(len(sample.points))
        return Sample(sample.points.take(order, axis=0), sample.boxes, sample.labels)


def moved(sample: Sample, settings: TrainingSettings, random: np.random.Generator) -> Sample:
    """Mirror, turn and scale a frame. The points and boxes of `sample` are changed in place."""
    mirrored = random.random() < 0.5  # drawn in any case: turns and scales stay what they are
    mirror = settings.flip_y and mirrored
    angle = random.uniform(-settings.rotation, settings.rotation)
    scale = np.float32(random.uniform(*settings.scaling))
    cos, sin = np.float32(math.cos(angle)), np.float32(math.sin(angle))
    boxes = sample.boxes
    for rows in (sample.points, boxes):
        _move(rows, mirror, cos, sin, scale)
    boxes[:, 3:6] *= scale
    if mirror:
        boxes[:, 6] *= -1
    boxes[:, 6] += angle
    boxes[:, 6] -= 2 * math.pi * np.floor(boxes[:, 6] / (2 * math.pi) + 0.5)
    return sample


@njit(cache=True)
def _move(rows, mirror, cos, sin, scale) -> None:
    """Mirror, turn and scale x, y and z, which come first, in place and in float32."""
    for i in range(len(rows)):
        x, y = rows[i, 0], -rows[i, 1] if mirror else rows[i, 1]
        rows[i, 0], rows[i, 1] = (x * cos - y * sin) * scale, (x * sin + y * cos) * scale
        rows[i, 2] *= scale


def within_range(sample: Sample, point_range: PointRange) -> Sample:
    """Drop points and boxes outside `point_range` as seen from above, at any height."""
    # In the points' own precision, which spares a copy of them in double.
    low, high = np.array(point_range, np.float32).reshape(2, 3)[:, :2]
    rows = _within(sample.boxes, low, high)
    # `take` copies rows ten times as fast as an index.
    points = sample.points.take(_within(sample.points, low, high), axis=0)
    return Sample(points, sample.boxes[rows], sample.labels[rows])


@njit(cache=True)
def _within(rows, low, high) -> NDArray[np.int64]:
    """Select the rows whose x and y, the first columns, are between two corners."""
    inside = np.empty(len(rows), np.int64)
    count = 0
    for i in range(len(rows)):
        inside[count] = i
        x, y = rows[i, 0], rows[i, 1]
        count += (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
    return inside[:count]

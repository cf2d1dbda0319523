"""Ground-truth sampling: objects of other frames are pasted into a frame (Yan et al., SECOND)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from training.dataset import Sample, TrainingFrames
from training.ops.points_in_boxes import box_of_points
from training.ops.rotated_iou import bev_overlap


@dataclass(frozen=True)
class ObjectDatabase:
    """The objects of all training frames with their points, packed, in the frame of a detector.

    Attributes:
        points: of object after object, shape (P, 4), float32.
        offsets: object k has `points[offsets[k]:offsets[k + 1]]`, shape (K + 1,), int64.
        boxes: shape (K, 7), float32.
        labels: shape (K,), int64.
        numbers: of each object among `all_objects`, shape (K,), int64.
        all_objects: objects of the ground truth, those included that have too few points.
        wanted: number of objects that a frame is filled up to, by label.
    """

    points: NDArray[np.float32]
    offsets: NDArray[np.int64]
    boxes: NDArray[np.float32]
    labels: NDArray[np.int64]
    numbers: NDArray[np.int64]
    all_objects: int
    wanted: Mapping[int, int]

    @classmethod
    def of(
        cls,
        frames: TrainingFrames,
        classes: Sequence[str],
        sample_groups: Mapping[str, int],
        min_points: int,
    ) -> "ObjectDatabase":
        """Gather the objects of `frames` that have `min_points` points or more.

        Args:
            classes: names of the labels 1, 2, ….
            sample_groups: number of objects that a frame is filled up to, by class; the objects of
                other classes are not gathered.
        """
        wanted = {1 + classes.index(n): k for n, k in sample_groups.items() if n in classes and k}
        points = [np.zeros((0, 4), np.float32)]
        counts = [np.zeros(0, np.int64)]
        boxes = [np.zeros((0, 7), np.float32)]
        labels = [np.zeros(0, np.int64)]
        numbers = [np.zeros(0, np.int64)]
        for index in range(len(frames)) if wanted else ():
            sample = frames[index]
            owner = _owners(sample.points, sample.boxes)
            count = np.bincount(owner + 1, minlength=len(sample.boxes) + 1)[1:]
            kept = np.isin(sample.labels, list(wanted)) & (count >= max(1, min_points))
            rows = np.argsort(owner, kind="stable")[np.count_nonzero(owner < 0) :]
            points.append(sample.points[rows[kept[owner[rows]]]])
            counts.append(count[kept])
            boxes.append(sample.boxes[kept])
            labels.append(sample.labels[kept])
            numbers.append(frames.objects(index)[kept])
        offsets = np.concatenate([np.zeros(1, np.int64), np.cumsum(np.concatenate(counts))])
        return cls(
            np.concatenate(points),
            offsets,
            np.concatenate(boxes),
            np.concatenate(labels),
            np.concatenate(numbers),
            frames.all_objects,
            wanted,
        )

    def paste(self, sample: Sample, random: np.random.Generator) -> Sample:
        """Fill a frame up with random objects at their own places.

        As OpenPCDet's database sampler with LIMIT_WHOLE_SCENE: for each class in turn as many
        objects are drawn as the frame lacks; those that overlap, seen from above, with an object
        of the frame or with one another are left out. Their points take the place of those that
        the frame has inside their boxes.

        All objects of the ground truth are put in a random order, and the first of those that have
        points are taken: rigs that do not see the same objects still paste the same where they can.
        """
        boxes, drawn = sample.boxes, []
        rank = random.random(self.all_objects)[self.numbers]
        for label, wanted in self.wanted.items():
            known = np.flatnonzero(self.labels == label)
            lacking = wanted - int(np.count_nonzero(sample.labels == label))
            if lacking <= 0 or not len(known):
                continue
            if lacking < len(known):  # sorting all of them would cost more than all else here
                known = known[np.argpartition(rank[known], lacking)[:lacking]]
            chosen = known[np.argsort(rank[known])]
            others = np.concatenate([self.boxes[chosen], boxes])
            overlapping = bev_overlap(self.boxes[chosen], others) > 0
            np.fill_diagonal(overlapping, False)
            chosen = chosen[~overlapping.any(axis=1)]
            boxes = np.concatenate([boxes, self.boxes[chosen]])
            drawn.append(chosen)
        objects = np.concatenate([np.zeros(0, np.int64), *drawn])
        if not len(objects):
            return sample
        free = np.flatnonzero(_owners(sample.points, self.boxes[objects]) < 0)
        own = [self.points[self.offsets[k] : self.offsets[k + 1]] for k in objects.tolist()]
        return Sample(
            np.concatenate([*own, sample.points.take(free, axis=0)]),
            boxes,
            np.concatenate([sample.labels, self.labels[objects]]),
        )


def _owners(points: NDArray[np.float32], boxes: NDArray[np.float32]) -> NDArray[np.int64]:
    """Row of the box that each point lies in, -1 outside all, shape (N,)."""
    return box_of_points(torch.from_numpy(points), torch.from_numpy(boxes)).numpy()

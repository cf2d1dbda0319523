"""Ground-truth sampling: objects of other frames are pasted into a frame (Yan et al., SECOND)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from training.dataset import Sample, TrainingFrames
from training.ops.points_in_boxes import box_of_points
from training.ops.rotated_iou import iou_bev


@dataclass(frozen=True)
class ObjectDatabase:
    """The objects of all training frames with their points, packed, in the frame of a detector."""

    points: NDArray[np.float32]  # of object after object, shape (P, 4), float32
    offsets: NDArray[np.int64]  # object k has `points[offsets[k]:offsets[k + 1]]`, shape (K + 1,)
    boxes: NDArray[np.float32]  # shape (K, 7), float32
    labels: NDArray[np.int64]  # shape (K,), int64
    numbers: NDArray[np.int64]  # of each object among `all_objects`, shape (K,), int64
    all_objects: int  # objects of the ground truth, those included that have too few points
    wanted: Mapping[int, int]  # number of objects that a frame is filled up to, by label

    @classmethod
    def of(
        cls,
        frames: TrainingFrames,
        classes: Sequence[str],
        sample_groups: Mapping[str, int],
        min_points: int,
    ) -> "ObjectDatabase":
        """Gather the objects of `frames` that have `min_points` points or more.

        `classes` are the labels 1, 2, …; a frame is filled up to `sample_groups` objects of a
        class; those of other classes are not gathered."""
        wanted = {1 + classes.index(n): k for n, k in sample_groups.items() if n in classes and k}
        none, no_box = np.zeros(0, np.int64), np.zeros((0, 7), np.float32)
        parts = [(np.zeros((0, 4), np.float32), none, no_box, none, none)]
        for index in range(len(frames)) if wanted else ():
            sample = frames[index]
            owner = _owners(sample.points, sample.boxes)
            count = np.bincount(owner + 1, minlength=len(sample.boxes) + 1)[1:]
            usable = np.isin(sample.labels, list(wanted)) & (count >= max(1, min_points))
            rows = np.argsort(owner, kind="stable")[np.count_nonzero(owner < 0) :]
            points, boxes = sample.points[rows[usable[owner[rows]]]], sample.boxes[usable]
            numbers = frames.objects[index][usable]
            parts.append((points, count[usable], boxes, sample.labels[usable], numbers))
        points, counts, boxes, labels, numbers = map(np.concatenate, zip(*parts, strict=True))
        offsets = np.append(0, np.cumsum(counts))
        return cls(points, offsets, boxes, labels, numbers, frames.all_objects, wanted)

    def paste(self, sample: Sample, random: np.random.Generator) -> Sample:
        """Fill a frame up with random objects at their own places.

        As OpenPCDet's database sampler with LIMIT_WHOLE_SCENE: for each class in turn as many
        objects are drawn as the frame lacks; those that overlap, seen from above, with an object
        of the frame or with one another are left out. Points of the others replace those inside.

        All objects of the ground truth are put in a random order, and the first of those that have
        points are taken: rigs that do not see the same objects still paste the same where they can.
        """
        boxes, drawn = sample.boxes, []
        rank = random.random(self.all_objects)[self.numbers]
        for label, wanted in self.wanted.items():
            of_class = np.flatnonzero(self.labels == label)
            lacking = wanted - int(np.count_nonzero(sample.labels == label))
            if lacking <= 0 or not len(of_class):
                continue
            if lacking < len(of_class):  # sorting all of them would cost more than all else
                of_class = of_class[np.argpartition(rank[of_class], lacking)[:lacking]]
            chosen = of_class[np.argsort(rank[of_class])]
            others = np.concatenate([self.boxes[chosen], boxes])
            overlapping = iou_bev(self.boxes[chosen], others) > 0
            np.fill_diagonal(overlapping, False)
            chosen = chosen[~overlapping.any(axis=1)]
            boxes = np.concatenate([boxes, self.boxes[chosen]])
            drawn.append(chosen)
        objects = np.concatenate([np.zeros(0, np.int64), *drawn])
        if not len(objects):
            return sample
        free = np.flatnonzero(_owners(sample.points, self.boxes[objects]) < 0)
        pasted = [self.points[self.offsets[k] : self.offsets[k + 1]] for k in objects.tolist()]
        points = np.concatenate([*pasted, sample.points.take(free, axis=0)])
        return Sample(points, boxes, np.concatenate([sample.labels, self.labels[objects]]))


def _owners(points: NDArray[np.float32], boxes: NDArray[np.float32]) -> NDArray[np.int64]:
    """Row of the box that each point lies in, -1 outside all, shape (N,)."""
    rows = box_of_points(torch.from_numpy(points), [len(points)], [torch.from_numpy(boxes)])
    return rows.numpy()

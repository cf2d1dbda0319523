"""Labels of some frames, spread over a log, and how detections overlap them."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.boxes import GEOMETRY
from training.average_precision import FramePairs
from training.ops.rotated_iou import paired_iou

MOST_PAIRS = 5_000
"""Pairs of a label and a detection in the frames that are chosen."""

Boxes = NDArray[np.float64]
"""Shape (N, 7), columns of `GEOMETRY`."""


class Overlaps(NamedTuple):
    """Pairs of a label and a detection of its frame; rows, and their IoU, shape (pairs,)."""

    label: NDArray[np.int64]
    detection: NDArray[np.int64]
    iou: NDArray[np.float64]


@dataclass(frozen=True)
class Sample:
    """Labels of chosen frames, and all detections.

    Attributes:
        frames: all frames in their order: scene, frame, and poses where they are known.
        chosen: places in `frames` of those that are looked at, rising.
        labels: of the chosen frames, sorted by frame.
        place: place in `chosen` of the frame of each label.
        detections: of all frames.
        frame: place in `frames` of the frame of each detection."""

    frames: pd.DataFrame
    chosen: NDArray[np.int64]
    labels: pd.DataFrame
    place: NDArray[np.int64]
    detections: pd.DataFrame
    frame: NDArray[np.int64]

    @classmethod
    def of(cls, detections: pd.DataFrame, labels: pd.DataFrame, frames: pd.DataFrame) -> Self:
        """Choose as many frames with labels as `MOST_PAIRS` allows, at least one if there is any.

        Detections and labels have `frame`, `class` and `GEOMETRY`; those of other frames are left
        out."""
        frames = frames.sort_values("frame", ignore_index=True)
        number = pd.Series(frames.index, frames["frame"].to_numpy())
        labels, detections = (t[t["frame"].isin(number.index)] for t in (labels, detections))
        of_label, of_detection = (
            number[table["frame"]].to_numpy(np.int64) for table in (labels, detections)
        )
        counts = [np.bincount(rows, minlength=len(frames)) for rows in (of_label, of_detection)]
        labelled = np.flatnonzero(counts[0])
        pairs = int(counts[0] @ counts[1])
        size = min(len(labelled), max(1, MOST_PAIRS * len(labelled) // max(1, pairs)))
        chosen = labelled[np.linspace(0, len(labelled) - 1, size, dtype=int)]
        rows = np.argsort(of_label, kind="stable")
        rows = rows[np.isin(of_label[rows], chosen)]
        place = np.searchsorted(chosen, of_label[rows])
        return cls(frames, chosen, labels.iloc[rows], place, detections, of_detection)

    def chosen_detections(self) -> NDArray[np.bool_]:
        """Return a mask of the detections that are in the chosen frames."""
        return np.isin(self.frame, self.chosen)

    def overlaps(self, boxes: Boxes, frame: NDArray[np.int64], three_d: bool) -> Overlaps:
        """Compare the labels with `boxes`, in places of `frames`; from above, or in 3D."""
        place = np.clip(np.searchsorted(self.chosen, frame), 0, len(self.chosen) - 1)
        rows = np.flatnonzero(self.chosen[place] == frame)
        rows = rows[np.argsort(place[rows], kind="stable")]
        pairs = FramePairs.of(self.place, place[rows], len(self.chosen))
        row = rows[pairs.detection]
        labels = self.labels[list(GEOMETRY)].to_numpy(np.float64)[pairs.ground_truth]
        return Overlaps(pairs.ground_truth, row, paired_iou(labels, boxes[row], three_d))

    def largest(self, overlaps: Overlaps) -> NDArray[np.float64]:
        """The largest IoU of each label, shape (labels,)."""
        largest = np.zeros(len(self.labels))
        np.maximum.at(largest, overlaps.label, overlaps.iou)
        return largest

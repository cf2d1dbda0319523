"""The frames of a log in which detections are evaluated, and the objects that count there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd

from lidarplace.base.class_names import check_among
from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.visibility import ground_truth
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import POINTS
from lidarplace.scenes.datasets.class_maps import OTHER
from training.kitti_ap import overlaps_of, pairs_of, rows_of
from training.leave_out import overlapped_most

Counted = Literal["visible", "points"]
_FRAMES = 200
"""Frames at a time: pairs of boxes and detections of all would fill the memory."""


@dataclass(frozen=True)
class TestFrames:
    """The frames of one split, with all boxes, and the objects that count, as of `ground_truth`.

    Attributes:
        classes: of the objects.
        roi: that they are in.
        description: a sentence on them."""

    __test__ = False  # of pytest, which takes the name for one of its own

    log: BoxLog
    objects: pd.DataFrame
    classes: tuple[str, ...]
    roi: Roi
    description: str

    @classmethod
    def of(
        cls, whole: BoxLog, split: str, crop: Crop, classes: Sequence[str], counted: Counted
    ) -> TestFrames:
        """Select the frames of a split and the objects that count, by the rules of a sweep.

        `classes`: all of the frames if none is named. Counted are objects visible to an ideal
        sensor on the roof, as in a sweep, or with real points of the rig that recorded the log.
        Raises InputError: there is no such frame or object, or the log has no real points."""
        frames = whole.frames[whole.frames["split"] == split].reset_index(drop=True)
        if frames.empty:
            splits = ", ".join(sorted(set(whole.frames["split"]))) or "no frame"
            raise InputError("no frame of the split", place="--split", expected=split, found=splits)
        if counted == "points" and POINTS not in whole.boxes:
            fix = "`lidarplace convert --clouds` counts them"
            raise InputError("the log has no real points", place="--counted points", fix=fix)
        boxes = whole.boxes[whole.boxes["frame"].isin(frames["frame"])].reset_index(drop=True)
        log = replace(whole, boxes=boxes, frames=frames)
        present = [str(name) for name in boxes["class"].unique() if name != OTHER]
        check_among(classes, present, place="--class")
        x0, y0, z0, x1, y1, z1 = crop
        roi = Roi((x0, x1), (y0, y1), (z0, z1), 0.1)  # of whose voxels nothing is asked
        truths = ground_truth(log, roi.x, roi.y, roi.z, by_points=counted == "points")
        names = tuple(classes or sorted(present))
        truths = truths[truths["class"].isin(names)]
        if truths.empty:
            raise InputError("no object counts in these frames", place="--roi")
        individuals = len(truths[["scene", "object_id"]].drop_duplicates())
        routes = len(frames[["scene", "route"]].drop_duplicates())
        rule = {
            "visible": "visible to an ideal sensor on the roof, as in a sweep",
            "points": "with a real point of the rig that recorded the log",
        }[counted]
        description = (
            f"{len(truths):,} objects count ({individuals:,} individuals, {len(frames):,} {split} "
            f"frames, {routes:,} routes): in the ROI and {rule}."
        )
        return cls(log, truths, names, roi, description)

    @property
    def routes(self) -> pd.DataFrame:
        """Scene, frame, route and split of every frame."""
        return self.log.frames[["scene", "frame", "route", "split"]]

    def relevant(self, detections: pd.DataFrame) -> pd.DataFrame:
        """Return the detections that are right or wrong about an object that counts.

        A detection that overlaps most an object that does not count, seen from above, is neither a
        hit nor a false alarm; nor is one that overlaps none with its centre outside the ROI."""
        low, high = np.transpose([self.roi.x, self.roi.y, self.roi.z])
        parts = [detections.iloc[:0]]
        numbers = np.sort(self.log.frames["frame"].to_numpy(np.int64))
        for frames in np.array_split(numbers, -(-len(numbers) // _FRAMES)):
            boxes, rows = rows_of(self.log.boxes, frames), rows_of(detections, frames)
            pairs = pairs_of(boxes, rows, frames)
            overlaps = overlaps_of(boxes, rows, pairs, three_d=False)
            nearest = overlapped_most(pairs, overlaps, len(rows))
            centre = rows[["x", "y", "z"]].to_numpy(np.float64)
            inside = ((centre >= low) & (centre <= high)).all(axis=1)
            counts = np.append(boxes.index.isin(self.objects.index), False)
            parts.append(rows[np.where(nearest >= 0, counts[nearest], inside)])
        return pd.concat(parts, ignore_index=True)

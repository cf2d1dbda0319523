"""Which ground truths of a class were found: recall object by object."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.boxes import GEOMETRY
from training.average_precision import FramePairs, hit_scores
from training.ops.rotated_iou import paired_iou


def found_objects(objects: pd.DataFrame, detections: pd.DataFrame, iou: float) -> NDArray[np.bool_]:
    """Whether some detection overlaps each object in 3D by more than `iou`, each used once.

    The mean of it is `class_recall_3D` of `training.kitti_ap.evaluate_boxes`.

    Args:
        objects, detections: boxes of one class with `frame`, detections also with `score`.

    Returns:
        In the order of `objects`, shape (objects,).
    """
    frames = np.unique(objects["frame"])
    found = detections[detections["frame"].isin(frames)].sort_values("frame", kind="stable")
    order = np.argsort(objects["frame"].to_numpy(), kind="stable")
    truths = objects.iloc[order]
    pairs = FramePairs.of(
        np.searchsorted(frames, truths["frame"].to_numpy()),
        np.searchsorted(frames, found["frame"].to_numpy()),
        len(frames),
    )
    overlaps = paired_iou(
        truths[list(GEOMETRY)].to_numpy(np.float64)[pairs.ground_truth],
        found[list(GEOMETRY)].to_numpy(np.float64)[pairs.detection],
        three_d=True,
    )
    scores = hit_scores(pairs, overlaps, found["score"].to_numpy(np.float64), iou)
    hit = np.empty(len(objects), np.bool_)
    hit[order] = ~np.isnan(scores)
    return hit

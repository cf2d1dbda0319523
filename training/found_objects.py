"""Which ground truths of a class were found: recall object by object."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from training.average_precision import hit_scores
from training.kitti_ap import overlaps_of, pairs_of, rows_of


def found_objects(objects: pd.DataFrame, detections: pd.DataFrame, iou: float) -> NDArray[np.bool_]:
    """Whether some detection overlaps each object in 3D by more than `iou`, each used once.

    The mean of it is `class_recall_3D` of `training.kitti_ap.evaluate_boxes`.

    Args:
        objects, detections: boxes of one class with `frame`, detections also with `score`.

    Returns:
        In the order of `objects`, shape (objects,).
    """
    frames = np.unique(objects["frame"])
    truths, found = rows_of(objects, frames), rows_of(detections, frames)
    pairs = pairs_of(truths, found, frames)
    overlaps = overlaps_of(truths, found, pairs, three_d=True)
    scores = hit_scores(pairs, overlaps, found["score"].to_numpy(np.float64), iou)
    hit = np.empty(len(objects), np.bool_)
    hit[np.argsort(objects["frame"].to_numpy(), kind="stable")] = ~np.isnan(scores)
    return hit

"""The overlap at which a class is judged."""

from __future__ import annotations

import pandas as pd

KITTI_IOU = {"Car": 0.7}
"""IoU at which KITTI counts a detection as true; 0.5 for the classes not named."""


def headline_iou(results: pd.DataFrame, object_class: str) -> float:
    """KITTI's IoU of the class, or the strictest one evaluated when KITTI's was not."""
    evaluated = results.loc[results["class"] == object_class, "iou"].unique()
    wanted = KITTI_IOU.get(object_class, 0.5)
    return wanted if wanted in evaluated or not len(evaluated) else float(max(evaluated))

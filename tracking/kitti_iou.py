"""The overlap at which a class is judged."""

from __future__ import annotations

import pandas as pd

from lidarplace.metrics import headline_metric, kitti_iou


def headline_iou(results: pd.DataFrame, object_class: str) -> float:
    """KITTI's IoU of the class, or the strictest one evaluated when KITTI's was not."""
    evaluated = results.loc[results["class"] == object_class, "iou"].unique()
    wanted = kitti_iou(object_class).strict
    return wanted if wanted in evaluated or not len(evaluated) else float(max(evaluated))


def judged(
    table: pd.DataFrame, results: pd.DataFrame, object_class: str, metric: str | None = None
) -> pd.DataFrame:
    """Rows of a class with its headline metric, or `metric`, at its headline IoU in `results`."""
    wanted = metric or headline_metric(object_class)
    own = table[(table["class"] == object_class) & (table["metric"] == wanted)]
    return own[own["iou"] == headline_iou(results, object_class)]

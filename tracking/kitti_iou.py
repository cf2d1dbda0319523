"""The overlap at which a class is judged."""

from __future__ import annotations

import pandas as pd

from lidarplace.metrics import EVERY_IOU, METRICS, headline_metric, kitti_iou


def headline_iou(results: pd.DataFrame, object_class: str, metric: str | None = None) -> float:
    """KITTI's IoU of the class, or the strictest one evaluated when KITTI's was not.

    `EVERY_IOU` for a metric that is of no single one.
    """
    if metric in METRICS and not METRICS[metric].of_one_iou:
        return EVERY_IOU
    evaluated = results.loc[results["class"] == object_class, "iou"].unique()
    wanted = kitti_iou(object_class).strict
    return wanted if wanted in evaluated or not len(evaluated) else float(max(evaluated))


def judged(
    table: pd.DataFrame, results: pd.DataFrame, object_class: str, metric: str | None = None
) -> pd.DataFrame:
    """Rows of a class with its headline metric, or `metric`, at its headline IoU in `results`."""
    wanted = metric or headline_metric(object_class)
    own = table[(table["class"] == object_class) & (table["metric"] == wanted)]
    return own[own["iou"] == headline_iou(results, object_class, wanted)]


def judged_by_all(table: pd.DataFrame, results: pd.DataFrame, object_class: str) -> pd.DataFrame:
    """Rows of a class with any metric, each at its headline IoU in `results`."""
    own = table[table["class"] == object_class]
    return own[own["iou"].isin([headline_iou(results, object_class), EVERY_IOU])]

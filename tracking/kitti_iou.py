"""The IoU at which a class is evaluated."""

import pandas as pd

from lidarplace.base.metrics import EVERY_IOU, METRICS, headline_metric, kitti_iou

_OF_AP = [name for name, own in METRICS.items() if own.of_one_iou and not own.of_all]


def headline_iou(results: pd.DataFrame, object_class: str, metric: str | None = None) -> float:
    """The strictest IoU at which AP of the class was evaluated; KITTI's of all classes together.

    `EVERY_IOU` for a metric without a single IoU.
    """
    if metric and metric in METRICS and not METRICS[metric].of_one_iou:
        return EVERY_IOU
    own = results[results["class"] == object_class]
    evaluated = own.loc[own["metric"].isin(_OF_AP), "iou"]
    if len(evaluated):
        return float(evaluated.max())
    wanted = kitti_iou(object_class).strict
    return wanted if own.empty or wanted in set(own["iou"]) else float(own["iou"].max())


def at_headline_iou(
    table: pd.DataFrame, results: pd.DataFrame, object_class: str, metric: str | None = None
) -> pd.DataFrame:
    """Rows of a class with its headline metric, or `metric`, at its headline IoU in `results`."""
    wanted = metric or headline_metric(object_class)
    own = table[(table["class"] == object_class) & (table["metric"] == wanted)]
    return own[own["iou"] == headline_iou(results, object_class, wanted)]


def at_headline_ious(table: pd.DataFrame, results: pd.DataFrame, object_class: str) -> pd.DataFrame:
    """Rows of a class with any metric, each at its headline IoU in `results`."""
    own = table[table["class"] == object_class]
    return own[own["iou"].isin([headline_iou(results, object_class), EVERY_IOU])]

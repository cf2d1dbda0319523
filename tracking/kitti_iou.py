"""IoU at which a class is evaluated."""

import pandas as pd

from lidarplace.base.metrics import EVERY_IOU, METRICS, headline_metric, kitti_iou

_OF_AP = [name for name, metric in METRICS.items() if metric.of_one_iou and not metric.of_all]


def headline_iou(results: pd.DataFrame, object_class: str, metric: str | None = None) -> float:
    """Return the strictest IoU at which AP of the class was evaluated.

    Of all classes together KITTI's; `EVERY_IOU` for a metric without a single IoU."""
    if metric and metric in METRICS and not METRICS[metric].of_one_iou:
        return EVERY_IOU
    of_class = results[results["class"] == object_class]
    evaluated = of_class.loc[of_class["metric"].isin(_OF_AP), "iou"]
    if len(evaluated):
        return float(evaluated.max())
    wanted = kitti_iou(object_class).strict
    return (
        wanted if of_class.empty or wanted in set(of_class["iou"]) else float(of_class["iou"].max())
    )


def at_headline_iou(
    table: pd.DataFrame, results: pd.DataFrame, object_class: str, metric: str | None = None
) -> pd.DataFrame:
    """Select rows of a class with its headline metric, or `metric`, at its headline IoU.

    The headline's IoU is that in `results`."""
    wanted = metric or headline_metric(object_class)
    of_metric = table[(table["class"] == object_class) & (table["metric"] == wanted)]
    return of_metric[of_metric["iou"] == headline_iou(results, object_class, wanted)]


def at_headline_ious(table: pd.DataFrame, results: pd.DataFrame, object_class: str) -> pd.DataFrame:
    """Select rows of a class with any metric, each at its headline IoU in `results`."""
    of_class = table[table["class"] == object_class]
    return of_class[of_class["iou"].isin([headline_iou(results, object_class), EVERY_IOU])]

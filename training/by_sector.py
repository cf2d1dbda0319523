"""Recall by the direction of the objects."""

from collections.abc import Mapping
from types import MappingProxyType

import pandas as pd

from lidarplace.base.metrics import Overlaps, iou_of
from lidarplace.base.sectors import SECTORS, bounds_of, sector_of

COLUMNS = ("class", "metric", "iou", "sector", "from_deg", "to_deg", "value", "ground_truths")


def recall_by_sector(
    objects: pd.DataFrame, ious: Mapping[str, Overlaps] = MappingProxyType({})
) -> pd.DataFrame:
    """Recall of the `objects` of an `Evaluation` by sector around the vehicle, at the strict IoU.

    Objects are matched as for the recall of all directions, which is the mean of these, weighted by
    their ground truths.

    Returns columns class, metric ("recall", and "class_recall_3D" of single classes), iou, sector,
    its bounds from_deg and to_deg (`lidarplace.base.sectors.bounds_of`), value (percent) and
    ground_truths. Sectors without objects of the class have no row.
    """
    placed = objects[["class", "overlap", "found"]].assign(sector=sector_of(objects))
    rows = []
    for name, own in [*placed.groupby("class", sort=False), ("all", placed)]:
        iou = iou_of(str(name), ious).strict
        recalled = own.assign(recalled=own["overlap"] > iou).groupby("sector")
        for sector, group in recalled:
            place = (iou, SECTORS[int(str(sector))], *bounds_of(int(str(sector))))
            of_metric = {"recall": group["recalled"], "class_recall_3D": group["found"]}
            rows += [
                (name, metric, *place, 100 * hit.mean(), len(group))
                for metric, hit in of_metric.items()
                if name != "all" or metric == "recall"
            ]
    return pd.DataFrame(rows, columns=list(COLUMNS))

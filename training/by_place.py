"""AP of detections by the distance of the objects, and recall by their direction."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base import sectors
from lidarplace.base.metrics import OF_CLASSES, Overlaps, iou_of
from lidarplace.base.rings import bounds_of, ring_of
from training.kitti_ap import evaluation, overlaps_of, pairs_of, rows_of
from training.leave_out import overlapped_most

_KEYS, _VALUES = ("class", "metric", "iou"), ("value", "ground_truths")
_BY_DISTANCE = (*_KEYS, "from_m", "to_m", *_VALUES)
_BY_SECTOR = (*_KEYS, "sector", "from_deg", "to_deg", *_VALUES)


def evaluate_by_distance(
    ground_truth: pd.DataFrame,
    detections: pd.DataFrame,
    frames: Sequence[int],
    classes: Sequence[str],
    ious: Mapping[str, Overlaps] = MappingProxyType({}),
) -> pd.DataFrame:
    """Compute the metrics of single classes by `evaluate_boxes` in each ring around the vehicle.

    A detection belongs to the ring of the object of its class that it overlaps most, seen from
    above, and to that of its own centre if it overlaps none: an object at 19.9 m that was found at
    20.1 m is found. Arguments and errors as of `training.kitti_ap.evaluation`.

    Returns columns class, metric, iou, from_m, to_m (bounds of the ring), value (percent) and
    ground_truths. Rings without objects of the class have no row."""
    tables = []
    for name in classes:
        truths = ground_truth[ground_truth["class"] == name]
        detected = detections[detections["class"] == name]
        rings = ring_of(truths)
        detection_rings = _rings_of_detections(truths, detected, frames)
        for ring in np.unique(rings).tolist():
            of_ring = truths[rings == ring], detected[detection_rings == ring]
            table = evaluation(*of_ring, frames, [name], ious=ious).metrics
            table = table[(table["class"] == name) & table["metric"].isin(OF_CLASSES)]
            low, high = bounds_of(ring)
            tables.append(table.assign(from_m=low, to_m=high)[list(_BY_DISTANCE)])
    tables = [table[table["ground_truths"] > 0] for table in tables]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=_BY_DISTANCE)


def _rings_of_detections(
    truths: pd.DataFrame, detections: pd.DataFrame, frames: Sequence[int]
) -> NDArray[np.int64]:
    """Ring in which each detection is evaluated, shape (rows,)."""
    rings = ring_of(detections)
    numbers = np.unique(np.asarray(frames, np.int64))
    truths, detections = (
        rows_of(table.reset_index(drop=True), numbers) for table in (truths, detections)
    )
    pairs = pairs_of(truths, detections, numbers)
    overlaps = overlaps_of(truths, detections, pairs, three_d=False)
    nearest = overlapped_most(pairs, overlaps, len(detections))
    meets = nearest >= 0
    rings[detections.index[meets]] = ring_of(truths)[nearest[meets]]
    return rings


def recall_by_sector(
    objects: pd.DataFrame, ious: Mapping[str, Overlaps] = MappingProxyType({})
) -> pd.DataFrame:
    """Compute the recall of `Evaluation.objects` by sector around the vehicle, strict IoU.

    Objects are matched as for the recall of all directions, which is the mean of these, weighted by
    their ground truths.

    Returns columns class, metric ("recall", and "class_recall_3D" of single classes), iou, sector,
    its bounds from_deg and to_deg (`lidarplace.base.sectors.bounds_of`), value (percent) and
    ground_truths. Sectors without objects of the class have no row."""
    by_sector = objects[["class", "overlap", "found"]].assign(sector=sectors.sector_of(objects))
    rows = []
    for name, of_class in [*by_sector.groupby("class", sort=False), ("all", by_sector)]:
        iou = iou_of(str(name), ious).strict
        recalled = of_class.assign(recalled=of_class["overlap"] > iou).groupby("sector")
        for sector, group in recalled:
            place = (iou, sectors.SECTORS[int(str(sector))], *sectors.bounds_of(int(str(sector))))
            of_metric = {"recall": group["recalled"], "class_recall_3D": group["found"]}
            rows += [
                (name, metric, *place, 100 * hit.mean(), len(group))
                for metric, hit in of_metric.items()
                if name != "all" or metric == "recall"
            ]
    return pd.DataFrame(rows, columns=list(_BY_SECTOR))

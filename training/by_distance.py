"""AP of detections by the distance of the objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.metrics import OF_CLASSES, Overlaps
from lidarplace.base.rings import bounds_of, ring_of
from lidarplace.logs.boxes import GEOMETRY
from training.average_precision import FramePairs
from training.kitti_ap import evaluation
from training.ops.rotated_iou import paired_iou

COLUMNS = ("class", "metric", "iou", "from_m", "to_m", "value", "ground_truths")


def evaluate_by_distance(
    ground_truth: pd.DataFrame,
    detections: pd.DataFrame,
    frames: Sequence[int],
    classes: Sequence[str],
    ious: Mapping[str, Overlaps] = MappingProxyType({}),
) -> pd.DataFrame:
    """The metrics of single classes by `evaluate_boxes` in every ring around the vehicle.

    A detection belongs to the ring of the object of its class that it overlaps most, seen from
    above, and to that of its own centre if it overlaps none: an object at 19.9 m that was found at
    20.1 m is found.

    Args:
        ground_truth, detections, frames, classes, ious: as of `evaluate_boxes`.

    Returns:
        Columns class, metric, iou, from_m, to_m (bounds of the ring), value (percent) and
        ground_truths. Rings without objects of the class have no row.

    Raises:
        ValueError: as `training.kitti_ap.evaluation`.
    """
    tables = []
    for name in classes:
        truths = ground_truth[ground_truth["class"] == name]
        found = detections[detections["class"] == name]
        rings = ring_of(truths)
        rings_found = _rings_of_detections(truths, found, frames)
        for ring in np.unique(rings).tolist():
            table = evaluation(
                truths[rings == ring], found[rings_found == ring], frames, [name], ious=ious
            ).metrics
            table = table[(table["class"] == name) & table["metric"].isin(OF_CLASSES)]
            low, high = bounds_of(ring)
            tables.append(table.assign(from_m=low, to_m=high)[list(COLUMNS)])
    tables = [table[table["ground_truths"] > 0] for table in tables]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=COLUMNS)


def _rings_of_detections(
    truths: pd.DataFrame, found: pd.DataFrame, frames: Sequence[int]
) -> NDArray[np.int64]:
    """The ring that each row of `found` is judged in; shape (rows,)."""
    numbers = np.unique(np.asarray(frames, np.int64))
    here = [np.flatnonzero(table["frame"].isin(numbers).to_numpy()) for table in (truths, found)]
    # Pairs are within frames, whose rows have to stand together.
    own, other = (
        rows[np.argsort(table["frame"].to_numpy()[rows], kind="stable")]
        for table, rows in zip((truths, found), here, strict=True)
    )
    pairs = FramePairs.of(
        np.searchsorted(numbers, truths["frame"].to_numpy(np.int64)[own]),
        np.searchsorted(numbers, found["frame"].to_numpy(np.int64)[other]),
        len(numbers),
    )
    truth, detection = own[pairs.ground_truth], other[pairs.detection]
    overlap = paired_iou(
        truths[list(GEOMETRY)].to_numpy(np.float64)[truth],
        found[list(GEOMETRY)].to_numpy(np.float64)[detection],
        False,
    )
    meets = overlap > 0
    truth, detection, overlap = truth[meets], detection[meets], overlap[meets]
    rings = ring_of(found)
    rising = np.argsort(overlap, kind="stable")  # of several assignments the last one stays
    rings[detection[rising]] = ring_of(truths)[truth[rising]]
    return rings

"""AP and recall without each route, and without each individual, of the test frames in turn.

The spread of what remains is the jackknife's estimate of how much another test set would change the
number (`tracking.statistics.jackknife`).

AP_R40 moves in steps of 2.5 points of recall, and the jackknife of what is not smooth is
inconsistent (of the median: Efron 1979; in general: Shao and Wu 1989). So AP without a route or an
individual is the area under precision over recall at every hit, which AP_R40 samples; the area of
all test frames is there too, to compare with. Halves of the test frames have AP_R40."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.metrics import EVERY_IOU, MEAN_AP_IOU, Overlaps
from training.average_precision import FramePairs
from training.matches import Matches, by_unit

MOST_UNITS = 100  # more are thrown together at random: the delete-a-group jackknife (Kott 2001)
STRETCHES = 20  # of frames, most for false alarms
SPLITS = 5  # most ways of halving the routes
COLUMNS = ("class", "metric", "iou", "unit", "left_out", "ground_truths", "members", "value")


@dataclass(frozen=True)
class Units:
    """Units of one kind, each left out in turn."""

    kind: str  # "route", "individual" or "half", or "nothing", which leaves nothing out
    names: tuple[str, ...]  # of the units, the same for all detectors
    truth: NDArray[np.int64]  # unit of every ground truth, shape (G,)
    detection: NDArray[np.int64]  # unit of every detection, shape (D,)
    members: NDArray[np.float64] | float = 1.0  # see `_numbered`

    def table(
        self, object_class: str, metric: str, iou: float, values: NDArray[np.float64]
    ) -> pd.DataFrame:
        """Table of `COLUMNS` of the values without each unit."""
        counts = by_unit(self.truth, len(self.names)).astype(np.int64)
        cells = (object_class, metric, iou, self.kind, self.names, counts, self.members, values)
        return pd.DataFrame(dict(zip(COLUMNS, cells, strict=True)))


def units_of(
    truths: pd.DataFrame,
    detection_frame: NDArray[np.int64],
    nearest: NDArray[np.int64],
    routes: pd.DataFrame,
) -> list[Units]:
    """List the units of one class: routes, individuals, nothing, and halves.

    Nothing is what the first two are compared with: AP as an area, see above. Halves of the routes
    are of several splits that are drawn at random: "0a" and "0b", "1a", …; none of one route.
    Without one half a metric is that of the other.

    A detection belongs to the individual that it overlaps most. False alarms overlap none: those in
    a stretch of consecutive frames are a unit, and a stretch has as many frames as an individual,
    the mean over boxes: what is taken for an object may stay as long.

    `truths` have scene, object_id and frame, `routes` scene, frame and route of all frames;
    `nearest` (D,) is the row of `truths` that a detection overlaps most, -1 for none."""
    route, names, of_routes = _numbered(routes, ["scene", "route"])
    frame = routes["frame"].to_numpy(np.int64)
    of_frame = pd.Series(route, frame)
    truth, detection = (
        of_frame.reindex(rows).to_numpy(np.int64) for rows in (truths["frame"], detection_frame)
    )
    individual, individuals, of_individuals = _numbered(truths, ["scene", "object_id"])
    boxes = by_unit(individual, len(individuals))
    lasting = (boxes**2 / of_individuals).sum() / boxes.sum()
    stretches = int(np.clip(len(frame) / lasting, 2, STRETCHES))
    stretch = np.arange(len(frame)) * stretches // len(frame)
    of_frame = pd.Series(stretch, frame[np.lexsort((frame, route))])
    alarm = len(individuals) + of_frame.reindex(detection_frame).to_numpy(np.int64)
    owner = np.where(nearest >= 0, individual[nearest], alarm)
    alarms = tuple(f"false alarms {number}" for number in range(stretches))
    members = np.concatenate([of_individuals, np.ones(len(alarms))])
    units = [
        Units("route", names, truth, detection, of_routes),
        Units("individual", (*individuals, *alarms), individual, owner, members),
        Units("nothing", ("",), np.full(len(truths), -1), np.full(len(detection_frame), -1)),
    ]
    random, every = np.random.default_rng(0), frozenset(range(len(names)))
    splits: list[frozenset[int]] = []
    for _ in range(4 * SPLITS if len(names) > 1 else 0):
        half = frozenset(random.permutation(len(names))[: len(names) // 2].tolist())
        if half not in splits and every - half not in splits and len(splits) < SPLITS:
            splits.append(half)
    for i, half in enumerate(splits):
        one, other = (np.isin(rows, [*half]).astype(np.int64) for rows in (truth, detection))
        units.append(Units("half", (f"{i}a", f"{i}b"), one, other))
    return units


def overlapped_most(
    pairs: FramePairs, overlaps: NDArray[np.float64], detections: int
) -> NDArray[np.int64]:
    """Row of the ground truth that each detection overlaps most, shape (D,); -1: none."""
    nearest = np.full(detections, -1)
    rising = np.argsort(overlaps, kind="stable")  # of several assignments the last one stays
    rising = rising[overlaps[rising] > 0]
    nearest[pairs.detection[rising]] = pairs.ground_truth[rising]
    return nearest


def ap_without_each(
    object_class: str,
    ious: Overlaps,
    matches: Mapping[tuple[str, float], Matches],
    either: Sequence[Units],
) -> list[pd.DataFrame]:
    """AP and recall of a class at `ious` without each of `units_of`; but for halves AP is an area.

    `matches`: by view, "3D" or "BEV", and IoU: of `ious`, and in 3D of `MEAN_AP_IOU`."""
    tables = []
    for units in either:
        of_each = (units.truth, units.detection, len(units.names))
        without = Matches.ap_without_each if units.kind == "half" else Matches.area_without_each
        ap = {key: without(match, *of_each) for key, match in matches.items()}
        for view, iou in product(("3D", "BEV"), ious):
            tables.append(units.table(object_class, f"AP_R40_{view}", iou, ap[view, iou]))
        mean = np.mean([ap["3D", iou] for iou in MEAN_AP_IOU], axis=0)
        tables.append(units.table(object_class, "AP_R40_3D_mean", EVERY_IOU, mean))
    recalls = [("class_recall_3D", iou, matches["3D", iou].found) for iou in ious]
    return tables + means_without_each(object_class, recalls, either)


def means_without_each(
    object_class: str,
    metrics: Sequence[tuple[str, float, NDArray[np.float64] | NDArray[np.bool_]]],
    either: Sequence[Units],
) -> list[pd.DataFrame]:
    """Metrics that are means over ground truths, in percent, without each unit; NaN: none is left.

    Each metric has a name, an IoU and the values, shape (G,), of which it is a mean."""
    tables = []
    for (metric, iou, of_truth), units in product(metrics, either):
        size = len(units.names)
        left = len(of_truth) - by_unit(units.truth, size)
        total = of_truth.sum() - by_unit(units.truth, size, of_truth.astype(np.float64))
        mean = np.where(left > 0, 100 * total / np.maximum(left, 1), np.nan)
        tables.append(units.table(object_class, metric, iou, mean))
    return tables


def _numbered(
    table: pd.DataFrame, keys: list[str]
) -> tuple[NDArray[np.int64], tuple[str, ...], NDArray[np.float64]]:
    """Number the units with these keys, in their order; more than `MOST_UNITS` are grouped.

    Number of each row, names of the numbers, and how many units of equal size each number has:
    (Σn)² / Σn² over units of n rows."""
    number = np.asarray(table.groupby(keys, sort=True).ngroup(), np.int64)
    first = table[keys].assign(number=number).drop_duplicates("number").sort_values("number")
    names = tuple(" ".join(map(str, row)) for row in first[keys].to_numpy().tolist())
    if len(names) <= MOST_UNITS:
        return number, names, np.ones(len(names))
    group = np.random.default_rng(0).permutation(len(names)) % MOST_UNITS
    sizes = np.bincount(number).astype(np.float64)
    members = by_unit(group, MOST_UNITS, sizes) ** 2 / by_unit(group, MOST_UNITS, sizes**2)
    return group[number], tuple(f"group {number}" for number in range(MOST_UNITS)), members

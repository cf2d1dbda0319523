"""AP and recall of detections: for box logs, and by KITTI's official rules for its labels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.metrics import EVERY_IOU, MEAN_AP_IOU, METRICS, Overlaps, iou_of
from lidarplace.files.columns import check_columns, numbers
from lidarplace.logs.boxes import GEOMETRY, check_boxes
from lidarplace.logs.plausibility import check_yaw
from training import kitti_labels, leave_out
from training.average_precision import (
    COUNTS,
    FramePairs,
    PrecisionCurve,
    Roles,
    ap_r11,
    ap_r40,
    hit_scores,
    precision_curve,
)
from training.matches import Matches
from training.ops.rotated_iou import paired_iou

RECALL_IOU = (0.5, 0.7)
COLUMNS = ("class", "metric", "iou", "difficulty", "value", "ground_truths")
CURVE_COLUMNS = ("class", "metric", "iou", "recall", "precision")


_Row = tuple[str, str, float, str, float, int]  # a row of COLUMNS


@dataclass(frozen=True)
class Evaluation:
    """Metrics of the detections of some frames, and what they are computed from."""

    metrics: pd.DataFrame  # `evaluate_boxes`
    # The curves of which the APs are means: class, metric ("AP_R40_3D", "AP_R40_BEV"), iou, and at
    # the 41 recall points 0, 2.5, …, 100 the precision, both in percent; none of classes without
    # ground truth
    curves: pd.DataFrame
    # The ground truths, with `overlap`, the largest 3D IoU with a box of their frame ("recall"
    # counts those above its IoU), and `found`, whether "class_recall_3D" counts them at the strict
    # IoU
    objects: pd.DataFrame
    # The metrics without each route, each individual and halves of the routes, see `leave_out`:
    # values in percent, NaN where no ground truth is left; None unless routes were given
    left_out: pd.DataFrame | None = None


def evaluate_boxes(
    ground_truth: pd.DataFrame,
    detections: pd.DataFrame,
    frames: Sequence[int],
    classes: Sequence[str],
    refined: pd.DataFrame | None = None,
    ious: Mapping[str, Overlaps] = MappingProxyType({}),
) -> pd.DataFrame:
    """Compute AP and recall over `frames`; rows of other frames and classes are left out.

    All tables have `frame` and x, y, z, length, width, height, yaw in the ego frame, the first two
    also `class`, and detections `score`. Per class:

    - "AP_R40_3D" and "AP_R40_BEV" at the strict and the loose IoU of `ious`, or KITTI's;
    - "AP_R40_3D_mean": the mean of the former over the IoUs 0.3, 0.35, …, 0.8;
    - "class_recall_3D" at the same: the share of the ground truths that AP's curve reaches, so by
      detections of their class, each used once;
    - "recall" at 0.5 and 0.7: the share of the ground truths that some box of their frame, whatever
      its class, overlaps in 3D by more (OpenPCDet's recall_rcnn, which the paper prints). The boxes
      are `refined`, those of a second stage before any is dropped, or else the detections. Class
      "all" has it over all classes;
    - "mean_overlap": the mean over the ground truths of the largest 3D IoU with a detection of
      their frame and class, 0 where there is none; for class "all" with one of any class.

    KITTI samples recall at 41 of the hits: with n < 41 ground truths even a perfect detector has
    AP_R40 (n - 1) / 40 only. Compare AP where there are more, and recall where there are fewer.

    Returns columns class, metric, iou (`lidarplace.base.metrics.EVERY_IOU` for metrics of no single
    one), difficulty ("all"), value (percent) and ground_truths. The value of a class without ground
    truth is NaN, where KITTI's rule gives 0.

    Raises ValueError if a column is missing, a box or a score is not a finite number, or a yaw is
    over two turns, as if it were in degrees."""
    tables = {"ground truth": ground_truth, "detections": detections}
    if refined is not None:
        tables["refined boxes"] = refined.assign(**{"class": ""})
    for source, table in tables.items():
        check_boxes(table, source)
        check_yaw(table["yaw"], source)
    return evaluation(ground_truth, detections, frames, classes, refined, ious=ious).metrics


def evaluation(
    ground_truth: pd.DataFrame,
    detections: pd.DataFrame,
    frames: Sequence[int] | pd.DataFrame,
    classes: Sequence[str],
    refined: pd.DataFrame | None = None,
    ious: Mapping[str, Overlaps] = MappingProxyType({}),
    metrics: Sequence[str] = (),
) -> Evaluation:
    """Compute `evaluate_boxes`, the curves behind it, and the metrics without each route.

    Arguments and errors as there, but any yaw, as a log may be accepted with it. `frames` are
    numbers, or a table with scene, frame and route: only with a table are metrics computed without
    each route, and the ground truth then needs columns scene and object_id. `metrics` are further
    ones, of plug-ins."""
    check_boxes(ground_truth, "ground truth")
    check_boxes(detections, "detections")
    check_columns(list(detections.columns), ["score"], "detections")
    numbers(detections, ["score"], "detections")
    if refined is not None:
        check_boxes(refined.assign(**{"class": ""}), "refined boxes")
    routes = frames if isinstance(frames, pd.DataFrame) else None
    wanted = np.unique(np.asarray(frames if routes is None else routes["frame"], np.int64))
    truths = rows_of(ground_truth, wanted)
    truths = truths[truths["class"].isin(list(classes))]
    detected = rows_of(detections, wanted)
    pairs = pairs_of(truths, detected, wanted)
    overlaps = overlaps_of(truths, detected, pairs, three_d=True)
    best = largest = _largest(overlaps, pairs, len(truths))
    if refined is not None:
        boxes = rows_of(refined, wanted)
        refined_pairs = pairs_of(truths, boxes, wanted)
        best = _largest(overlaps_of(truths, boxes, refined_pairs, True), refined_pairs, len(truths))
    hit = np.zeros(len(truths), np.bool_)
    rows: list[_Row] = []
    curves: list[pd.DataFrame] = []
    left_out: list[pd.DataFrame] = []
    for name in classes:
        of_truth, of_detection = (t["class"].to_numpy() == name for t in (truths, detected))
        of_pair = of_truth[pairs.ground_truth] & of_detection[pairs.detection]
        of_both = truths[of_truth], detected[of_detection]
        class_pairs = pairs_of(*of_both, wanted)
        views = {"3D": overlaps[of_pair], "BEV": overlaps_of(*of_both, class_pairs, False)}
        of_class = _ClassBoxes(
            name, *of_both, class_pairs, views, best[of_truth], iou_of(name, ious)
        )
        hit[of_truth] = of_class.matches["3D", of_class.ious.strict].found
        rows += of_class.rows(metrics)
        curves += of_class.curve_tables()
        left_out += of_class.without_each(routes) if routes is not None else ()
    of_all = _means(best, largest)
    rows += [("all", name, iou, "all", _percent(mean), len(truths)) for name, iou, mean in of_all]
    if routes is not None and len(truths):
        no_detection = np.zeros(0, np.int64)
        units = leave_out.units_of(truths, no_detection, no_detection, routes)
        left_out += leave_out.means_without_each("all", of_all, units)
    return Evaluation(
        pd.DataFrame(rows, columns=list(COLUMNS)),
        _stack(curves, CURVE_COLUMNS),
        truths.assign(overlap=best, found=hit),
        None if routes is None else _stack(left_out, leave_out.COLUMNS),
    )


@dataclass(frozen=True)
class _ClassBoxes:
    """Ground truths and detections of one class, with their overlaps."""

    name: str
    truths: pd.DataFrame
    detected: pd.DataFrame
    pairs: FramePairs
    overlaps: Mapping[str, NDArray[np.float64]]  # of the pairs, "3D" and "BEV"
    best: NDArray[np.float64]  # largest overlap of each ground truth that "recall" counts
    ious: Overlaps

    @cached_property
    def matches(self) -> dict[tuple[str, float], Matches]:
        """Matches by view and IoU."""
        scores = self.detected["score"].to_numpy(np.float64, copy=True)
        return {
            (view, iou): Matches.of(self.pairs, values, scores, iou)
            for view, values in self.overlaps.items()
            for iou in dict.fromkeys((*self.ious, *MEAN_AP_IOU) if view == "3D" else self.ious)
        }

    @cached_property
    def curves(self) -> dict[tuple[str, float], NDArray[np.float64]]:
        """Precision at the recall points, by view and IoU."""
        return {key: match.precision() for key, match in self.matches.items()}

    @cached_property
    def largest(self) -> NDArray[np.float64]:
        """Largest 3D overlap of each ground truth with a detection of the class."""
        return _largest(self.overlaps["3D"], self.pairs, len(self.truths))

    def rows(self, metrics: Sequence[str]) -> list[_Row]:
        """Rows of `evaluate_boxes`, and of further metrics."""
        count = len(self.truths)
        values: list[tuple[str, float, float]] = []
        for iou in self.ious:
            matches = self.matches["3D", iou]
            for view in self.overlaps:
                values.append((f"AP_R40_{view}", iou, float(ap_r40(self.curves[view, iou]))))
            values.append(("class_recall_3D", iou, _percent(matches.found)))
            for metric in metrics:
                if (measure := METRICS[metric].of_matches) is not None:
                    compute = partial(measure, matches)
                    place = f"class {self.name}"
                    value = METRICS.number(metric, compute, place) if count else np.nan
                    values.append((metric, iou, value))
        values += [("recall", iou, _percent(self.best > iou)) for iou in RECALL_IOU]
        mean_curve = np.mean([self.curves["3D", iou] for iou in MEAN_AP_IOU], axis=0)
        values.append(("AP_R40_3D_mean", EVERY_IOU, float(ap_r40(mean_curve))))
        values.append(("mean_overlap", EVERY_IOU, _percent(self.largest)))
        return [
            (self.name, metric, iou, "all", value if count else np.nan, count)
            for metric, iou, value in values
        ]

    def curve_tables(self) -> Iterator[pd.DataFrame]:
        """Yield tables of CURVE_COLUMNS; none without ground truth."""
        for iou, view in product(self.ious, self.overlaps if len(self.truths) else ()):
            curve = self.curves[view, iou]
            recall = np.linspace(0, 100, len(curve))
            values = (self.name, f"AP_R40_{view}", iou, recall, 100 * curve)
            yield pd.DataFrame(dict(zip(CURVE_COLUMNS, values, strict=True)))

    def without_each(self, routes: pd.DataFrame) -> list[pd.DataFrame]:
        """Tables of the metrics without each route and so on; none without ground truth."""
        if not len(self.truths):
            return []
        frame = self.detected["frame"].to_numpy(np.int64)
        nearest = leave_out.overlapped_most(self.pairs, self.overlaps["BEV"], len(frame))
        units = leave_out.units_of(self.truths, frame, nearest, routes)
        means = leave_out.means_without_each(self.name, _means(self.best, self.largest), units)
        return leave_out.ap_without_each(self.name, self.ious, self.matches, units) + means


def _means(
    best: NDArray[np.float64], overlap: NDArray[np.float64]
) -> list[tuple[str, float, NDArray[np.float64]]]:
    """Metrics that are means over ground truths: name, IoU and values, from overlaps (G,)."""
    recall = [("recall", iou, (best > iou).astype(np.float64)) for iou in RECALL_IOU]
    return [*recall, ("mean_overlap", EVERY_IOU, overlap)]


def _stack(tables: Sequence[pd.DataFrame], columns: Sequence[str]) -> pd.DataFrame:
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=list(columns))


def rows_of(table: pd.DataFrame, frames: NDArray[np.int64]) -> pd.DataFrame:
    """Select the rows of `frames`, sorted by frame; rows of a frame keep their order."""
    return table[table["frame"].isin(frames)].sort_values("frame", kind="stable")


def pairs_of(truths: pd.DataFrame, detected: pd.DataFrame, frames: NDArray[np.int64]) -> FramePairs:
    """Pair ground truths and detections of each frame; both are results of `rows_of`."""
    truth_frame, detection_frame = (
        np.searchsorted(frames, table["frame"].to_numpy(np.int64)) for table in (truths, detected)
    )
    return FramePairs.of(truth_frame, detection_frame, len(frames))


def overlaps_of(
    truths: pd.DataFrame, detected: pd.DataFrame, pairs: FramePairs, three_d: bool
) -> NDArray[np.float64]:
    """IoU of every pair, in 3D or seen from above."""
    truth, box = (t[list(GEOMETRY)].to_numpy(np.float64) for t in (truths, detected))
    return paired_iou(truth[pairs.ground_truth], box[pairs.detection], three_d)


def _largest(overlaps: NDArray[np.float64], pairs: FramePairs, truths: int) -> NDArray[np.float64]:
    """Largest overlap that each ground truth has in a pair, 0 if it is in none, shape (G,)."""
    largest = np.zeros(truths)
    np.maximum.at(largest, pairs.ground_truth, overlaps)
    return largest


def found_objects(objects: pd.DataFrame, detections: pd.DataFrame, iou: float) -> NDArray[np.bool_]:
    """Mark the objects that some detection overlaps in 3D by more than `iou`, each used once.

    Boxes of one class with `frame`, detections also with `score`; the mean of what is returned,
    (objects,), is `class_recall_3D` of `evaluate_boxes`."""
    frames = np.unique(objects["frame"])
    truths, detected = rows_of(objects, frames), rows_of(detections, frames)
    pairs = pairs_of(truths, detected, frames)
    overlaps = overlaps_of(truths, detected, pairs, three_d=True)
    scores = hit_scores(pairs, overlaps, detected["score"].to_numpy(np.float64, copy=True), iou)
    hit = np.empty(len(objects), np.bool_)
    hit[np.argsort(objects["frame"].to_numpy(), kind="stable")] = ~np.isnan(scores)
    return hit


def _percent(values: NDArray[np.float64] | NDArray[np.bool_]) -> float:
    """Mean in percent; NaN without values."""
    return float(100 * values.mean()) if len(values) else float("nan")


def _official_values(view: str, curve: PrecisionCurve, oriented: bool) -> dict[str, float]:
    values = {
        f"AP_R40_{view}": float(ap_r40(curve.precision)),
        f"AP_R11_{view}": ap_r11(curve.precision),
        f"class_recall_{view}": 100 * curve.recall,
    }
    if oriented:
        values["AOS_R40"] = float(ap_r40(curve.similarity))
        values["AOS_R11"] = ap_r11(curve.similarity)
    return values


def evaluate_detections(
    ground_truth: pd.DataFrame,
    detections: pd.DataFrame,
    frames: int | Sequence[int],
    iou: Mapping[str, float],
    min_height: bool = True,
) -> pd.DataFrame:
    """Compute KITTI's official AP of tables with its label columns, camera frame.

    Rules as in KITTI's development kit: objects that are too occluded, truncated or low in the
    image for a difficulty are ignored, so are `Van` for Car and `Person_sitting` for Pedestrian;
    `DontCare` regions excuse detections in the image metric only.

    Args:
        ground_truth: frame, class, truncated, occluded, alpha, left, top, right, bottom, height,
            width, length, x, y, z (bottom centre), rotation_y.
        detections: the same and score.
        frames: the frames evaluated; a number n stands for 0, …, n - 1.
        iou: overlap that a hit must exceed, per class; the classes that are evaluated.
        min_height: apply the rule of minimum height in the image (the paper's fork does not).

    Returns columns class, metric, iou, difficulty, value (percent) and ground_truths: those that
    count. Metrics per difficulty: "AP_R40_3D", "AP_R40_BEV", "AP_R40_image" and their "AP_R11_…",
    the recall that each curve reaches, "class_recall_3D", …, and "AOS_R40" and "AOS_R11", the
    average orientation similarity in the image, unless detections have KITTI's mark -10 for an
    unknown alpha; and "recall" (3D, whatever the detection's class, difficulty "all"). No ground
    truth gives 0.

    Raises ValueError: a column is missing, a number not finite, or a rotation_y over two turns."""
    wanted = np.unique(frames if np.ndim(frames) else np.arange(int(np.asarray(frames))))
    truths = rows_of(kitti_labels.checked_labels(ground_truth, "ground truth", ()), wanted)
    detected = rows_of(kitti_labels.checked_labels(detections, "detections", ("score",)), wanted)
    pairs = pairs_of(truths, detected, wanted)
    scores = detected["score"].to_numpy(np.float64, copy=True)
    truth_boxes = kitti_labels.boxes_z_up(truths)[pairs.ground_truth]
    detected_boxes = kitti_labels.boxes_z_up(detected)[pairs.detection]
    overlaps = {
        "3D": paired_iou(truth_boxes, detected_boxes, three_d=True),
        "BEV": paired_iou(truth_boxes, detected_boxes, three_d=False),
        "image": kitti_labels.image_iou(truths, detected, pairs),
    }
    best = _largest(overlaps["3D"], pairs, len(truths))
    covered = kitti_labels.covered_by_dont_care(truths, detected, pairs)
    similarity = kitti_labels.orientation_similarity(truths, detected, pairs)
    known_alpha = bool((detected["alpha"] != kitti_labels.UNKNOWN_ALPHA).all())
    rows: list[_Row] = []
    for name, minimum in iou.items():
        for level, difficulty in enumerate(kitti_labels.DIFFICULTIES):
            truth_role = kitti_labels.ground_truth_role(truths, name, level, min_height)
            detection_role = kitti_labels.detection_role(detected, name, level, min_height)
            values: dict[str, float] = {}
            for view, overlap in overlaps.items():
                harmless = covered > (minimum if view == "image" else np.inf)
                roles = Roles(truth_role, detection_role, harmless)
                curve = precision_curve(pairs, overlap, scores, minimum, roles, similarity)
                values |= _official_values(view, curve, view == "image" and known_alpha)
            count = int((truth_role == COUNTS).sum())
            rows += [
                (name, key, minimum, difficulty, value, count) for key, value in values.items()
            ]
        of_class = best[truths["class"].to_numpy(object) == name.lower()]
        recall = _percent(of_class > minimum) if len(of_class) else 0.0
        rows.append((name, "recall", minimum, "all", recall, len(of_class)))
    return pd.DataFrame(rows, columns=list(COLUMNS))

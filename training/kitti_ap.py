"""AP and recall of detections: for box logs, and by KITTI's official rules for its labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
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


@dataclass(frozen=True)
class Evaluation:
    """What the detections of some frames are worth."""

    metrics: pd.DataFrame  # `evaluate_boxes`
    # What the APs are means of: class, metric ("AP_R40_3D", "AP_R40_BEV"), iou, and at the 41
    # recall points 0, 2.5, …, 100 the precision, both in percent; none of classes without ground
    # truth
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
    """AP and recall over `frames`; rows of other frames and classes are left out.

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
    over two turns, as if it were in degrees.
    """
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
    frames: Sequence[int],
    classes: Sequence[str],
    refined: pd.DataFrame | None = None,
    routes: pd.DataFrame | None = None,
    ious: Mapping[str, Overlaps] = MappingProxyType({}),
    metrics: Sequence[str] = (),
) -> Evaluation:
    """`evaluate_boxes`, the precision over recall behind it, and what hangs on each route.

    Arguments and errors as there, but any yaw, as a log may be accepted with it; and `routes`:
    scene, frame and route of the frames. With these the ground truth needs columns scene and
    object_id; and `metrics`: further ones, of plug-ins.
    """
    check_boxes(ground_truth, "ground truth")
    check_boxes(detections, "detections")
    check_columns(list(detections.columns), ["score"], "detections")
    numbers(detections, ["score"], "detections")
    if refined is not None:
        check_boxes(refined.assign(**{"class": ""}), "refined boxes")
    wanted = np.unique(np.asarray(frames, np.int64))
    truths = rows_of(ground_truth, wanted)
    truths = truths[truths["class"].isin(list(classes))]
    found = rows_of(detections, wanted)
    rows: list[tuple[str, str, float, str, float, int]] = []
    drawn: list[pd.DataFrame] = []
    without: list[pd.DataFrame] = []

    def add(name: str, metric: str, iou: float, value: float, count: int) -> None:
        rows.append((name, metric, iou, "all", value if count else np.nan, count))

    every = pairs_of(truths, found, wanted)
    every_overlap = overlaps_of(truths, found, every, three_d=True)
    of_any = _largest(every_overlap, every, len(truths))
    best = of_any
    if refined is not None:
        boxes = rows_of(refined, wanted)
        other = pairs_of(truths, boxes, wanted)
        best = _largest(overlaps_of(truths, boxes, other, three_d=True), other, len(truths))
    reached = np.zeros(len(truths), np.bool_)
    truth_class, found_class = truths["class"].to_numpy(), found["class"].to_numpy()
    for name in classes:
        here = truth_class == name
        own = truths[here]
        own_found = found[found_class == name]
        pairs = pairs_of(own, own_found, wanted)
        scores = own_found["score"].to_numpy(np.float64, copy=True)
        alike = here[every.ground_truth] & (found_class == name)[every.detection]
        overlaps = {
            "3D": every_overlap[alike],
            "BEV": overlaps_of(own, own_found, pairs, three_d=False),
        }
        of_class = _largest(overlaps["3D"], pairs, len(own))
        of_name = iou_of(name, ious)
        matches = {
            (view, iou): Matches.of(pairs, values, scores, iou)
            for view, values in overlaps.items()
            for iou in dict.fromkeys((*of_name, *MEAN_AP_IOU) if view == "3D" else of_name)
        }
        reached[here] = matches["3D", of_name.strict].found
        if routes is not None and len(own):
            nearest = leave_out.overlapped_most(pairs, overlaps["BEV"], len(own_found))
            frame = own_found["frame"].to_numpy(np.int64)
            units = leave_out.units_of(own, frame, nearest, routes)
            without += leave_out.ap_without_each(name, of_name, matches, units)
            without += leave_out.means_without_each(name, _means(best[here], of_class), units)
        curves = {key: match.precision() for key, match in matches.items()}
        for iou in of_name:
            for view in overlaps:
                metric, curve = f"AP_R40_{view}", curves[view, iou]
                add(name, metric, iou, float(ap_r40(curve)), len(own))
                if len(own):
                    values = (name, metric, iou, np.linspace(0, 100, len(curve)), 100 * curve)
                    drawn.append(pd.DataFrame(dict(zip(CURVE_COLUMNS, values, strict=True))))
            add(name, "class_recall_3D", iou, _percent(matches["3D", iou].found), len(own))
            for metric in metrics:
                if (measure := METRICS[metric].of_matches) is not None:
                    compute = partial(measure, matches["3D", iou])
                    value = METRICS.number(metric, compute, f"class {name}") if len(own) else np.nan
                    add(name, metric, iou, value, len(own))
        for iou in RECALL_IOU:
            add(name, "recall", iou, _percent(best[here] > iou), len(own))
        mean_curve = np.mean([curves["3D", iou] for iou in MEAN_AP_IOU], axis=0)
        add(name, "AP_R40_3D_mean", EVERY_IOU, float(ap_r40(mean_curve)), len(own))
        add(name, "mean_overlap", EVERY_IOU, _percent(of_class), len(own))
    for metric, iou, of_truth in _means(best, of_any):
        add("all", metric, iou, _percent(of_truth), len(truths))
    if routes is not None and len(truths):
        none = np.zeros(0, np.int64)
        units = leave_out.units_of(truths, none, none, routes)
        without += leave_out.means_without_each("all", _means(best, of_any), units)
    return Evaluation(
        pd.DataFrame(rows, columns=list(COLUMNS)),
        _stack(drawn, CURVE_COLUMNS),
        truths.assign(overlap=best, found=reached),
        None if routes is None else _stack(without, leave_out.COLUMNS),
    )


def _means(
    best: NDArray[np.float64], overlap: NDArray[np.float64]
) -> list[tuple[str, float, NDArray[np.float64]]]:
    """Metrics that are means over ground truths: name, IoU and values, from overlaps (G,)."""
    recall = [("recall", iou, (best > iou).astype(np.float64)) for iou in RECALL_IOU]
    return [*recall, ("mean_overlap", EVERY_IOU, overlap)]


def _stack(tables: Sequence[pd.DataFrame], columns: Sequence[str]) -> pd.DataFrame:
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=list(columns))


def rows_of(table: pd.DataFrame, frames: NDArray[np.int64]) -> pd.DataFrame:
    """Rows of the wanted frames, sorted by frame; rows of a frame keep their order."""
    return table[table["frame"].isin(frames)].sort_values("frame", kind="stable")


def pairs_of(truths: pd.DataFrame, found: pd.DataFrame, frames: NDArray[np.int64]) -> FramePairs:
    """The pairs of each frame; rows as of `rows_of`, which has the same frames."""
    return FramePairs.of(
        np.searchsorted(frames, truths["frame"].to_numpy(np.int64)),
        np.searchsorted(frames, found["frame"].to_numpy(np.int64)),
        len(frames),
    )


def overlaps_of(
    truths: pd.DataFrame, found: pd.DataFrame, pairs: FramePairs, three_d: bool
) -> NDArray[np.float64]:
    """IoU of every pair, in 3D or seen from above."""
    return paired_iou(
        truths[list(GEOMETRY)].to_numpy(np.float64)[pairs.ground_truth],
        found[list(GEOMETRY)].to_numpy(np.float64)[pairs.detection],
        three_d,
    )


def _largest(overlaps: NDArray[np.float64], pairs: FramePairs, truths: int) -> NDArray[np.float64]:
    """Largest overlap that each ground truth has in a pair, 0 if it is in none, shape (G,)."""
    largest = np.zeros(truths)
    np.maximum.at(largest, pairs.ground_truth, overlaps)
    return largest


def found_objects(objects: pd.DataFrame, detections: pd.DataFrame, iou: float) -> NDArray[np.bool_]:
    """Whether some detection overlaps each object in 3D by more than `iou`, each used once.

    Boxes of one class with `frame`, detections also with `score`; the mean of what is returned,
    (objects,), is `class_recall_3D` of `evaluate_boxes`.
    """
    frames = np.unique(objects["frame"])
    truths, found = rows_of(objects, frames), rows_of(detections, frames)
    pairs = pairs_of(truths, found, frames)
    overlaps = overlaps_of(truths, found, pairs, three_d=True)
    scores = hit_scores(pairs, overlaps, found["score"].to_numpy(np.float64, copy=True), iou)
    hit = np.empty(len(objects), np.bool_)
    hit[np.argsort(objects["frame"].to_numpy(), kind="stable")] = ~np.isnan(scores)
    return hit


def _percent(values: NDArray[np.float64] | NDArray[np.bool_]) -> float:
    """The mean, percent; NaN of nothing."""
    return float(100 * values.mean()) if len(values) else float("nan")


def evaluate_detections(
    ground_truth: pd.DataFrame,
    detections: pd.DataFrame,
    frames: int | Sequence[int],
    iou: Mapping[str, float],
    min_height: bool = True,
) -> pd.DataFrame:
    """KITTI's official AP of tables with its label columns, camera frame.

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

    Raises ValueError: a column is missing, a number not finite, or a rotation_y over two turns.
    """
    wanted = np.unique(frames if np.ndim(frames) else np.arange(int(np.asarray(frames))))
    truths = rows_of(kitti_labels.checked_labels(ground_truth, "ground truth", ()), wanted)
    found = rows_of(kitti_labels.checked_labels(detections, "detections", ("score",)), wanted)
    pairs = pairs_of(truths, found, wanted)
    scores = found["score"].to_numpy(np.float64, copy=True)
    truth_sides = kitti_labels.boxes_z_up(truths)[pairs.ground_truth]
    found_sides = kitti_labels.boxes_z_up(found)[pairs.detection]
    overlaps = {
        "3D": paired_iou(truth_sides, found_sides, three_d=True),
        "BEV": paired_iou(truth_sides, found_sides, three_d=False),
        "image": kitti_labels.image_iou(truths, found, pairs),
    }
    truth_class, found_class = (own["class"].str.lower().to_numpy(str) for own in (truths, found))
    best = _largest(overlaps["3D"], pairs, len(truths))
    regions = truth_class == "dontcare"
    covered = kitti_labels.covered_by_dont_care(truths, found, pairs, regions)
    alike = kitti_labels.orientation_similarity(truths, found, pairs)
    oriented = (found["alpha"].to_numpy(np.float64) != kitti_labels.UNKNOWN_ALPHA).all()
    rows: list[tuple[str, str, float, str, float, int]] = []
    for name, minimum in iou.items():
        for level, difficulty in enumerate(kitti_labels.DIFFICULTIES):
            rule = name, level, min_height
            truth_role = kitti_labels.ground_truth_role(truths, truth_class, *rule)
            found_role = kitti_labels.detection_role(found, found_class, *rule)
            count = int((truth_role == COUNTS).sum())
            value: dict[str, float] = {}
            for view, values in overlaps.items():
                harmless = covered > (minimum if view == "image" else np.inf)
                roles = truth_role, found_role, harmless
                curve = precision_curve(pairs, values, scores, minimum, *roles, alike)
                value[f"AP_R40_{view}"] = float(ap_r40(curve.precision))
                value[f"AP_R11_{view}"] = ap_r11(curve.precision)
                value[f"class_recall_{view}"] = 100 * curve.recall
                if view == "image" and oriented:
                    value["AOS_R40"] = float(ap_r40(curve.similarity))
                    value["AOS_R11"] = ap_r11(curve.similarity)
            rows += [
                (name, key, minimum, difficulty, number, count) for key, number in value.items()
            ]
        own = best[truth_class == name.lower()]
        recall = _percent(own > minimum) if len(own) else 0.0
        rows.append((name, "recall", minimum, "all", recall, len(own)))
    return pd.DataFrame(rows, columns=list(COLUMNS))

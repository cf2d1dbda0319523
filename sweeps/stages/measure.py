"""The stage that compares detections of a command with the ground truth; it needs no network."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import pandas as pd

from lidarplace.base.metrics import METRICS, Overlaps
from sweeps.stages.ground_truth import GroundTruth
from sweeps.stages.stage import Stage


@dataclass(frozen=True, eq=False)
class DetectedFrames:
    """Detections in some frames.

    `detections`: `boxes` of `training.detect.Detections`. `frames`: the column frame of all in
    which objects were detected. `cautions`: implausible detections of a command, a line each."""

    detections: pd.DataFrame
    frames: pd.DataFrame
    cautions: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class EvaluationResult:
    """Detections of one split compared with the ground truth; percent at each class's IoUs.

    `metrics`, `pr_curves`, `left_out`: `metrics`, `curves` and `left_out` of
    `training.kitti_ap.Evaluation`. `by_distance`: columns of
    `training.by_place.evaluate_by_distance`. `by_sector`: columns of
    `training.by_place.recall_by_sector`. `detections`: `boxes` of `training.detect.Detections`."""

    metrics: pd.DataFrame
    pr_curves: pd.DataFrame
    left_out: pd.DataFrame
    by_distance: pd.DataFrame
    by_sector: pd.DataFrame
    detections: pd.DataFrame


EVALUATION_TABLES = {
    "metrics": "results",
    "pr_curves": "pr_curves",
    "left_out": "left_out",
    "by_distance": "distance",
    "by_sector": "sector",
}
"""Fields of an `EvaluationResult` that are tables of a run folder."""


@dataclass(frozen=True)
class MeasureStage(Stage[EvaluationResult]):
    """Compare the detections of a command with the ground truth; fields as of `Network`."""

    classes: tuple[str, ...]
    ious: tuple[tuple[str, Overlaps], ...]
    metrics: tuple[str, ...]

    name = "measure"
    order = 20
    ends_trial = True
    tables: ClassVar = EVALUATION_TABLES
    plugins: ClassVar = {"metrics": METRICS}

    def run(self, detected: DetectedFrames, *truths: GroundTruth) -> EvaluationResult:
        objects = pd.concat([truth.objects for truth in truths], ignore_index=True)
        routes = pd.concat([truth.frames for truth in truths], ignore_index=True)
        objects, routes = (
            table[table["frame"].isin(detected.frames["frame"])] for table in (objects, routes)
        )
        settings = (self.classes, dict(self.ious), None, self.metrics)
        return evaluate_detections(objects, detected.detections, routes, *settings)


def evaluate_detections(
    objects: pd.DataFrame,
    detections: pd.DataFrame,
    routes: pd.DataFrame,
    classes: Sequence[str],
    ious: Mapping[str, Overlaps],
    refined: pd.DataFrame | None = None,
    metrics: Sequence[str] = (),
) -> EvaluationResult:
    """Compare detections with the objects that count.

    `detections`: columns of `training.detect.Detections`, whoever made them. `routes`: scene, frame
    and route of the frames. `metrics`: further ones, of plug-ins."""
    from training.by_place import evaluate_by_distance, recall_by_sector
    from training.kitti_ap import evaluation

    frames = routes["frame"].tolist()
    whole = evaluation(objects, detections, routes, classes, refined, ious, metrics)
    assert whole.left_out is not None  # routes are given
    return EvaluationResult(
        metrics=whole.metrics,
        pr_curves=whole.curves,
        left_out=whole.left_out,
        by_distance=evaluate_by_distance(objects, detections, frames, classes, ious),
        by_sector=recall_by_sector(whole.objects, ious),
        detections=detections,
    )

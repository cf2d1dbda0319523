"""What detections of test frames are worth, whoever made them."""

from collections.abc import Mapping, Sequence

import pandas as pd

from lidarplace.base.metrics import Overlaps
from sweeps.tasks.results import Evaluated


def evaluated(
    objects: pd.DataFrame,
    found: pd.DataFrame,
    routes: pd.DataFrame,
    classes: Sequence[str],
    ious: Mapping[str, Overlaps],
    refined: pd.DataFrame | None = None,
    metrics: Sequence[str] = (),
) -> Evaluated:
    """Compare detections, columns of `training.detect.Detections`, with the objects that count; by
    scene, frame and route of the frames, and further metrics of plug-ins."""
    from training.by_place import evaluate_by_distance, recall_by_sector
    from training.kitti_ap import evaluation

    frames = routes["frame"].tolist()
    whole = evaluation(objects, found, frames, classes, refined, routes, ious, metrics)
    assert whole.left_out is not None  # routes are given
    return Evaluated(
        metrics=whole.metrics,
        pr_curves=whole.curves,
        left_out=whole.left_out,
        by_distance=evaluate_by_distance(objects, found, frames, classes, ious),
        by_sector=recall_by_sector(whole.objects, ious),
        detections=found,
    )

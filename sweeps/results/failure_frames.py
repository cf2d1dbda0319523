"""Clouds and detections of the frames that show which objects one rig finds and another misses."""

from collections.abc import Callable, Mapping
from itertools import product
from operator import attrgetter
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.clouds.clouds import JoinedClouds
from lidarplace.clouds.points_in_boxes import box_of_points
from lidarplace.logs.boxes import GEOMETRY
from sweeps.plan.trial import DetectorTrial, Plan, with_detector
from sweeps.store.local import Store
from tracking.findings.failures import Failures
from tracking.report.analysis import Analysis
from tracking.run_folders.arrays import FailureFrames

POINTS = 3000
"""Number of points outside objects that are kept of a cloud, at random: a page has forty clouds."""


def write_failure_frames(analysis: Analysis, plan: Plan, store: Store) -> FailureFrames | None:
    """Write the frames of the compared rigs into the run folder; None if no rigs are compared."""
    if analysis.pair is None:
        return None
    trials = {trial.key: trial for trial in with_detector(plan.trials)}
    frames = failure_frames(analysis.pair, trials, store)
    frames.write(analysis.complete.path)
    return frames


def failure_frames(
    failures: Failures, trials: Mapping[str, DetectorTrial], store: Store
) -> FailureFrames:
    """Load the frames of `Failures.telling`, with the detections of the lowest seed.

    `trials` are by key."""
    clouds, index, boxes = {}, {}, {}
    for key in failures.trials:
        clouds[key] = JoinedClouds([store.load(task) for task in trials[key].collect_test])
        index[key] = {frame: i for i, frame in enumerate(clouds[key].frames.tolist())}
        boxes[key] = store.read(trials[key].evaluate, attrgetter("detections"))
    return frames_of(failures, boxes, lambda key, frame: clouds[key][index[key][frame]])


def frames_of(
    failures: Failures,
    detections: Mapping[str, pd.DataFrame],
    cloud: Callable[[str, int], NDArray[np.float32]],
) -> FailureFrames:
    """Collect the frames of `Failures.telling` from detections by trial.

    `cloud` returns the points of a trial in a frame: x, y, z, intensity, shape (n, 4)."""
    chosen = failures.objects.iloc[failures.telling()]
    rigs, numbers = np.array(failures.rigs, np.str_), chosen["object"].to_numpy(np.int64)
    frames = FailureFrames(rigs, numbers, {}, {})
    places = enumerate(chosen["frame"].tolist())
    for (place, frame), (rig, key) in product(places, enumerate(failures.trials)):
        objects = failures.objects[failures.objects["frame"] == frame]
        boxes = objects[list(GEOMETRY)].to_numpy(np.float64)
        frames.points[f"{place}/{rig}"] = _thinned(cloud(key, frame), boxes)
        in_frame: Any = detections[key][detections[key]["frame"] == frame]
        frames.detections[f"{place}/{rig}"] = in_frame[[*GEOMETRY, "score"]].to_numpy(np.float64)
    return frames


def _thinned(cloud: NDArray[np.float32], boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Keep all points in boxes (m, 7) and at most `POINTS` others; x, y, z, shape (n, 3)."""
    on_objects = box_of_points(cloud, boxes) >= 0
    others = np.flatnonzero(~on_objects)
    if len(others) > POINTS:
        others = np.random.default_rng(0).choice(others, POINTS, replace=False)
    return cloud[np.sort(np.concatenate([np.flatnonzero(on_objects), others])), :3]

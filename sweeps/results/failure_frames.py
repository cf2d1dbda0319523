"""The clouds and detections of the frames that show what one rig finds and another one misses."""

from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.clouds.clouds import JoinedClouds
from lidarplace.clouds.points_in_boxes import box_of_points
from lidarplace.logs.boxes import GEOMETRY
from sweeps.plan.trial import DetectorTrial
from sweeps.store.local import Store
from tracking.findings.failures import Failures
from tracking.run_folders.arrays import FailureFrames

POINTS = 3000
"""Points outside objects that are kept of a cloud, drawn at random: a page has forty clouds."""


def failure_frames(
    failures: Failures, trials: Mapping[str, DetectorTrial], store: Store
) -> FailureFrames:
    """The frames of `Failures.telling`, with the detections of the lowest seed; trials by key."""
    clouds, index, boxes = {}, {}, {}
    for key in failures.trials:
        clouds[key] = JoinedClouds([store.load(task) for task in trials[key].collect_test])
        index[key] = {frame: i for i, frame in enumerate(clouds[key].frames.tolist())}
        boxes[key] = store.read(trials[key].evaluate, lambda found: found.detections)
    return frames_of(failures, boxes, lambda key, frame: clouds[key][index[key][frame]])


def frames_of(
    failures: Failures,
    detections: Mapping[str, pd.DataFrame],
    cloud: Callable[[str, int], NDArray[np.float32]],
) -> FailureFrames:
    """The same from detections by trial, and what gives the cloud of a trial in a frame."""
    shown = failures.objects.iloc[failures.telling()]
    found = FailureFrames(
        np.array(failures.rigs, np.str_), shown["object"].to_numpy(np.int64), {}, {}
    )
    frames = enumerate(shown["frame"].tolist())
    for (place, frame), (rig, key) in product(frames, enumerate(failures.trials)):
        objects = failures.objects[failures.objects["frame"] == frame]
        boxes = objects[list(GEOMETRY)].to_numpy(np.float64)
        found.points[f"{place}/{rig}"] = _thinned(cloud(key, frame), boxes)
        own: Any = detections[key][detections[key]["frame"] == frame]
        found.detections[f"{place}/{rig}"] = own[[*GEOMETRY, "score"]].to_numpy(np.float64)
    return found


def _thinned(cloud: NDArray[np.float32], boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """All points in boxes (m, 7), and at most `POINTS` others; x, y, z."""
    on_objects = box_of_points(cloud, boxes) >= 0
    others = np.flatnonzero(~on_objects)
    if len(others) > POINTS:
        others = np.random.default_rng(0).choice(others, POINTS, replace=False)
    return cloud[np.sort(np.concatenate([np.flatnonzero(on_objects), others])), :3]

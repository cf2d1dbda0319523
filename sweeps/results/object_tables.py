"""Objects of the test frames, and which of them each trial found."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.metrics import kitti_iou
from lidarplace.logs.boxes import GEOMETRY
from sweeps.plan.trial import DetectorTrial
from sweeps.results.trial_results import axis_values, with_columns
from sweeps.store.local import Store
from tracking.run_folders.sweep_tables import OBJECTS
from training.kitti_ap import found_objects

ABOUT = ("scene", "frame", "route", "object_id", "class", *GEOMETRY, "visibility", "occluded")


def object_tables(
    trials: Sequence[DetectorTrial], store: Store, axes: Sequence[str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Make `objects` and `found` of the run folder from evaluated trials and the further `axes`.

    Objects that several trials share are in it once."""
    scene_axes = OBJECTS.axes_of(axes)
    of_setting: dict[tuple[object, ...], pd.DataFrame] = {}
    hits, first = [], 0
    for trial in trials:
        setting = axis_values(trial, scene_axes)
        classes = trial.grid_point.point.classes
        place = (*(task.key for task in trial.test_truths), classes, *setting.values())
        if place not in of_setting:
            objects = _test_objects(trial, store)
            objects.insert(0, "object", first + np.arange(len(objects)))
            of_setting[place] = with_columns(objects, setting)
            first += len(objects)
        hits.append(_found(trial, of_setting[place], store))
    if not hits:
        return pd.DataFrame(), pd.DataFrame()
    return (pd.concat(of_setting.values(), ignore_index=True), pd.concat(hits, ignore_index=True))


def _test_objects(trial: DetectorTrial, store: Store) -> pd.DataFrame:
    truths = [store.load(task) for task in trial.test_truths]
    objects = pd.concat([truth.objects for truth in truths])
    frames = pd.concat([truth.frames for truth in truths])
    test = frames.loc[frames["split"] == "test", ["frame", "route"]]
    objects = objects[objects["class"].isin(trial.grid_point.point.classes)]
    return pd.DataFrame(objects.merge(test, on="frame")[list(ABOUT)])


def _found(trial: DetectorTrial, objects: pd.DataFrame, store: Store) -> pd.DataFrame:
    detections = store.read(trial.evaluate, lambda found: found.detections)
    counts = pd.concat(
        [store.read(task, lambda own: own.points_per_object) for task in trial.collect_test]
    ).set_index(["frame", "object_id"])["points"]
    counts = counts[~counts.index.duplicated()]  # an id that a frame has twice distinguishes no two
    points = counts.loc[pd.MultiIndex.from_frame(objects[["frame", "object_id"]])]
    columns = {"trial": trial.key, "object": objects["object"].to_numpy()}
    columns |= {"points": points.to_numpy(np.int64), "found": found_in(objects, detections)}
    return pd.DataFrame(columns)


def found_in(objects: pd.DataFrame, detections: pd.DataFrame) -> NDArray[np.bool_]:
    """Tell which objects were found at the strict IoU of their class, shape (objects,)."""
    hit = np.zeros(len(objects), np.bool_)
    for name in objects["class"].unique():
        of_class = (objects["class"] == name).to_numpy()
        boxes = detections[detections["class"] == name]
        hit[of_class] = found_objects(objects[of_class], boxes, kitti_iou(str(name)).strict)
    return hit

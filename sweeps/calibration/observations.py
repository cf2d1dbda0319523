"""Observations of a sweep: objects that its detectors found, and what the rigs hit of them."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from lidarplace.base.metrics import Overlaps, iou_of
from lidarplace.logs.box_log import join_logs, of_split
from lidarplace.recall.baselines import per_object
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.recall.detection_curve import CELL_M
from lidarplace.recall.surface_cells import SurfaceCells
from lidarplace.rigs.placement import Placement
from sweeps.configuration.file import ConfigError
from sweeps.plan.trial import DetectorTrial, Trial, with_detector
from sweeps.stages.collect import CollectStage
from sweeps.stages.task import tasks_of
from sweeps.store.local import Store
from training.kitti_ap import found_objects

COLUMNS = ("rig", "class", "iou", "scene", "route", "object_id", "points", "cells", "found")


TrialsByRig = Mapping[str, Sequence[DetectorTrial]]
"""Trials that differ in detector and seed alone, by their placement and further axes."""


def rigs_of(trials: Sequence[Trial], store: Store) -> TrialsByRig:
    """Find the rigs of which the store has detections. Raises ConfigError for recorded clouds."""
    by_rig: dict[str, list[DetectorTrial]] = {}
    for trial in with_detector(trials):
        if not store.has(trial.evaluate):
            continue
        if len(tasks_of(CollectStage, trial.collect_test)) < len(trial.collect_test):
            raise ConfigError("which rays made recorded clouds is not known", key="scene.clouds")
        axes = {k: v for k, v in trial.grid_point.axes.items() if k not in ("detector", "seed")}
        label = [axes.pop("placement", trial.grid_point.point.placement)]
        label += [f"{name}={value}" for name, value in axes.items()]
        by_rig.setdefault(" · ".join(label), []).append(trial)
    return by_rig


def observations(rigs: TrialsByRig, store: Store) -> pd.DataFrame:
    """Make a row for every object of the test frames that counts, rig and overlap of the class.

    Columns `COLUMNS`: `found` is the share of the rig's detectors that found the object, points
    and cells are what the rig hits of it, with the azimuth steps of its clouds."""
    counted: dict[tuple[object, ...], tuple[CountedObjects, pd.DataFrame]] = {}
    tables = []
    for label, trials in rigs.items():
        first, point = trials[0], trials[0].grid_point.point
        scenes = tuple(task.key for task in first.scenes)
        key = (scenes, point.scene.seed, point.voxel_roi(), point.classes, point.vehicle)
        if key not in counted:
            counted[key] = _test_objects(first, store)
        # The clouds of all parts of a scene are of one rig; it has their azimuth steps.
        (placement,) = {task.stage.placement for task in tasks_of(CollectStage, first.collect_test)}
        boxes = [store.read(trial.evaluate, lambda found: found.detections) for trial in trials]
        of_point = (*counted[key], point.classes, point.own_ious())
        tables.append(of_rig(label, placement, boxes, *of_point))
    return pd.concat(tables, ignore_index=True)


def _test_objects(trial: Trial, store: Store) -> tuple[CountedObjects, pd.DataFrame]:
    """Find the objects that count, and the frames that they are in."""
    log = of_split(join_logs([store.load(task) for task in trial.scenes]), "test")
    point = trial.grid_point.point
    objects = (log, point.voxel_roi(), point.classes, CELL_M)
    seed, vehicle = point.scene.seed, trial.grid_point.vehicle
    return CountedObjects.from_log(*objects, seed=seed, vehicle=vehicle), log.frames


def of_rig(
    label: str,
    placement: Placement,
    detections: Sequence[pd.DataFrame],
    objects: CountedObjects,
    frames: pd.DataFrame,
    classes: Sequence[str],
    ious: Mapping[str, Overlaps],
) -> pd.DataFrame:
    """Make columns `COLUMNS` of one rig, from the detections of each of its detectors.

    `frames` have the route of each frame, `ious` the overlaps of classes that have not KITTI's."""
    seen: SurfaceCells = objects.seen_by([placement])[0]
    routes = frames.set_index("frame")["route"]
    scene = objects.table["scene"].astype(str)
    route = scene + " " + objects.table["frame"].map(routes).astype(str)
    table, tables = per_object(objects, seen).assign(rig=label, scene=scene, route=route), []
    for name in classes:
        of_class = (table["class"] == name).to_numpy()
        objects_of_class = objects.table[of_class]
        for iou in iou_of(name, ious):
            hits = [
                found_objects(objects_of_class, box[box["class"] == name], iou)
                for box in detections
            ]
            tables.append(table[of_class].assign(iou=iou, found=np.mean(hits, axis=0)))
    return pd.concat(tables, ignore_index=True)[list(COLUMNS)]

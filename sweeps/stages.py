"""The stages of a sweep: functions from parameters and earlier results to a result.

They know nothing of Ray, of the store or of the grid. Parameters are plain data, so that they can
be hashed; a result is a dictionary of tables, arrays and plain data, so that it can be stored.

scene -> ground_truth, pog -> surrogates, coverage_accuracy
scene -> collect -> finetune -> evaluate
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from lidarplace import Lidar, Mount, OccupancyGrid, Placement, Roi, evaluate, evaluate_classes
from lidarplace.coverage import METHODS, coverage
from lidarplace.lidar.clouds import PointClouds
from lidarplace.surrogate import RAY_SURROGATES

Params = Mapping[str, Any]
Value = dict[str, Any]


def scene(params: Params) -> Value:
    """Record a traffic scene: the box log's two tables."""
    from lidarplace.scenes.settings import SumoScene
    from lidarplace.scenes.sumo import record  # needs SUMO

    boxes, frames = record(SumoScene.model_validate(params))
    return {"boxes": boxes, "frames": frames}


def ground_truth(params: Params, log: Value) -> Value:
    """Objects of every frame that count, the same for every placement."""
    from lidarplace.lidar.visibility import ground_truth as visible_objects

    return {"objects": visible_objects(log["boxes"], params["x"], params["y"], params["z"])}


def pog(params: Params, log: Value) -> Value:
    """Occupancy of one class over the frames of the training split.

    Test frames stay out: a surrogate predicts how a placement will do on what was not seen.
    """
    roi = Roi(**params["roi"])
    train = log["frames"].loc[log["frames"]["split"] == "train", "frame"]
    boxes = log["boxes"][log["boxes"]["frame"].isin(train)]
    grid = OccupancyGrid.from_boxes(boxes, roi, params["object_class"], frames=len(train))
    return {
        "counts": grid.counts,
        "from_above": grid.entropy.sum(axis=2, dtype=np.float64).astype(np.float32),
        "frames": grid.frames,
        "object_class": grid.object_class,
        "roi": params["roi"],
    }


def surrogates(params: Params, *pogs: Value) -> Value:
    """All surrogates asked for, for every class, and the coverage seen from above."""
    placement = _placement(params)
    covered = coverage(placement, Roi(**pogs[0]["roi"]), params["method"])
    results = evaluate_classes(
        {pog["object_class"]: _grid(pog) for pog in pogs},
        placement,
        method=params["method"],
        surrogates=[name for name in params["names"] if name in RAY_SURROGATES],
        detection_probability=params["detection_probability"],
        occlusion=params["occlusion"],
        covered=covered,
    )
    rows = [
        (object_class, name, float(getattr(result, name)), params["method"], result.seconds)
        for object_class, result in results.items()
        for name in (*params["names"], "covered_voxels")
    ]
    return {
        "table": pd.DataFrame(rows, columns=["class", "surrogate", "value", "method", "seconds"]),
        "from_above": covered.mean(axis=2, dtype=np.float32),
    }


def coverage_accuracy(params: Params, pog: Value) -> Value:
    """Error of S-MIG against seconds for every coverage method, against the exact cones."""
    placement, grid = _placement(params), _grid(pog)
    # The methods are compared, not sensors: the cones know no range that ends within the ROI.
    placement = placement.with_lidar(replace(placement.lidar, range=math.inf))
    runs = [("cone", 0)] + [
        (method, steps) for method in ("dda", "bresenham") for steps in params["azimuth_steps"]
    ]
    for method in METHODS:  # compiled, or loaded, before the clock starts
        coverage(placement, Roi((0, 1), (0, 1), (0, 1), 1.0), method)
    rows = []
    for method, steps in runs:
        result = evaluate(grid, placement, method=method, azimuth_steps=steps or None)
        rows.append((grid.object_class, method, steps, result.seconds, result.s_mig))
    table = pd.DataFrame(rows, columns=["class", "method", "azimuth_steps", "seconds", "s_mig"])
    s_mig = table["s_mig"].to_numpy()
    exact = s_mig[0]
    table["relative_error"] = np.abs(s_mig - exact) / abs(exact) if exact else np.nan
    return {"table": table}


def collect(params: Params, log: Value) -> Value:
    """Point clouds of one split under one placement."""
    from lidarplace.lidar.collect import collect as collect_clouds

    frames = log["frames"].loc[log["frames"]["split"] == params["split"], "frame"]
    clouds = collect_clouds(
        log["boxes"],
        frames.to_numpy(np.int64),
        _placement(params),
        crop=tuple(params["crop"]),
        seed=params["seed"],
    )
    return {
        "points": clouds.points,
        "lidar": clouds.lidar,
        "frames": clouds.frames,
        "offsets": clouds.offsets,
    }


def finetune(params: Params, clouds: Value, truth: Value) -> Value:
    """Train one detector on the clouds of one placement."""
    from training.finetune import finetune as train
    from training.settings import TrainingSettings

    result = train(
        params["detector"],
        params["classes"],
        point_clouds(clouds),
        truth["objects"],
        TrainingSettings.model_validate(params["training"]),
        seed=params["seed"],
        point_range=params["point_range"],
    )
    return {"state_dict": result.state_dict, "curve": result.curve}


def evaluate_detector(params: Params, weights: Value, clouds: Value, truth: Value) -> Value:
    """Detect on the test clouds and compare with the ground truth."""
    from training.finetune import detect
    from training.kitti_ap import evaluate_boxes
    from training.settings import TrainingSettings

    test = point_clouds(clouds)
    objects = truth["objects"]
    detections = detect(
        params["detector"],
        params["classes"],
        weights["state_dict"],
        test,
        TrainingSettings.model_validate(params["training"]),
        point_range=params["point_range"],
    )
    metrics = evaluate_boxes(
        objects[objects["frame"].isin(test.frames)],
        detections,
        test.frames.tolist(),
        params["classes"],
    )
    return {"metrics": metrics, "detections": detections}


FUNCTIONS: dict[str, Callable[..., Value]] = {
    "scene": scene,
    "ground_truth": ground_truth,
    "pog": pog,
    "surrogates": surrogates,
    "coverage_accuracy": coverage_accuracy,
    "collect": collect,
    "finetune": finetune,
    "evaluate": evaluate_detector,
}
"""Stages by name, in the order in which results flow."""


def point_clouds(value: Value) -> PointClouds:
    """The clouds in a result of `collect`."""
    return PointClouds(value["points"], value["lidar"], value["frames"], value["offsets"])


def _placement(params: Params) -> Placement:
    return Placement(
        "placement", [Mount(*pose) for pose in params["mounts"]], lidar=Lidar(**params["lidar"])
    )


def _grid(value: Value) -> OccupancyGrid:
    return OccupancyGrid(
        Roi(**value["roi"]), value["object_class"], value["counts"], value["frames"]
    )

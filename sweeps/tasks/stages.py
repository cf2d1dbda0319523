"""The stages of a sweep: functions from parameters and earlier results to a result.

They know nothing of Ray, of the store or of the grid. Parameters are frozen classes, which can be
hashed; a result is a dictionary of tables, arrays and plain data, which can be stored.

scene -> ground_truth, pog -> surrogates
scene -> recall, accuracy, sampling_error
requirements, which need no scene
scene -> collect -> finetune -> evaluate
scene -> collect -> pretrain (-> finetune) -> evaluate
scene -> judge, by a trained detector: collect and evaluate without anything kept between them
scene -> collect -> probe: how much memory a training needs

A scene may be recorded in parts; `*logs` are all of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from cachetools import LRUCache, cached
from numpy.typing import NDArray

from lidarplace import (
    OccupancyGrid,
    Roi,
    evaluate_classes,
    expected_ig_by_q,
)
from lidarplace.clouds.clouds import Clouds, JoinedClouds, PointClouds
from lidarplace.logs.box_log import BoxLog, join_logs
from lidarplace.pog.surrogates.evaluate import FAINT_Q, linear_share
from lidarplace.pog.surrogates.table import SURROGATES, to_ask_for
from sweeps.tasks.parameters import (
    AccuracyParams,
    CollectParams,
    GroundTruthParams,
    JudgeParams,
    NetworkParams,
    PogParams,
    ProbeParams,
    RecallParams,
    RecordedParams,
    RequirementsParams,
    SamplingErrorParams,
    SceneParams,
    SurrogateParams,
    TrainingParams,
)

if TYPE_CHECKING:
    from torch import Tensor

    from lidarplace.clouds.collect import SimulatedClouds
    from lidarplace.recall.expected_recall import ExpectedRecall

Value = dict[str, Any]


def scene(params: SceneParams) -> Value:
    """Simulate a part of a scene, or read it: the three tables of its box log."""
    log = params.recording.record()
    return {"boxes": log.boxes, "frames": log.frames, "buildings": log.buildings}


def ground_truth(params: GroundTruthParams, log: Value) -> Value:
    """Objects of every frame that count, the same for every placement, and all frames."""
    from lidarplace.clouds.visibility import ground_truth as visible_objects

    recorded = box_log(log)
    objects = visible_objects(recorded, params.x, params.y, params.z, seed=params.seed)
    return {"objects": objects, "frames": recorded.frames[["scene", "frame", "route", "split"]]}


def pog(params: PogParams, *logs: Value) -> Value:
    """Occupancy by every class over the frames of the training split.

    Test frames stay out: a surrogate predicts how a placement will do on what was not seen.
    """
    roi, log = params.roi, _training_log(logs)
    frames = len(log.frames)
    grids = OccupancyGrid.by_class(log.boxes, roi, params.classes, frames=frames)
    value: Value = {"classes": list(grids), "frames": frames, "roi": asdict(params.roi)}
    for object_class, grid in grids.items():
        value[f"counts_{object_class}"] = grid.counts
        # Not `grid.entropy`, which is twice as large as the counts and stays.
        from_above = [grid.entropy_of_count[counts].sum(axis=1) for counts in grid.counts]
        value[f"from_above_{object_class}"] = np.array(from_above, np.float32)
    return value


def surrogates(params: SurrogateParams, pog: Value) -> Value:
    """All surrogates of the POG that are asked for, for every class.

    `by_q` is `expected_ig` without occlusion for many q, from which one is fitted to measured AP;
    it is there if `expected_ig` is asked for, and so is `linear_share` in that surrogate's rows.
    """
    placement = params.placement
    grids = grids_of(pog)
    names = params.names
    results = (
        evaluate_classes(
            grids,
            placement,
            method=params.method,
            surrogates=to_ask_for(names),
            detection_probability=params.detection_probability,
            occlusion=params.occlusion,
        )
        if names
        else {}
    )
    rows = [
        (object_class, name, result[name], params.method, result.seconds)
        for object_class, result in results.items()
        for name in (*names, *(n for n, own in SURROGATES.own.items() if own.beside in names))
    ]
    columns = ["class", "surrogate", "value", "method", "seconds"]
    table = pd.DataFrame(rows, columns=columns).astype({"value": float, "seconds": float})
    value: Value = {"table": table}
    if "expected_ig" in names:
        q = params.detection_probability
        by_q = expected_ig_by_q(grids, placement, [*params.fitted_q, q, FAINT_Q])
        share = table["class"].map(linear_share(by_q, q))
        table["linear_share"] = share.where(table["surrogate"] == "expected_ig")
        by_q = by_q[list(params.fitted_q)].rename_axis("class").reset_index()
        value["by_q"] = by_q.melt("class", var_name="q", value_name="expected_ig")
    return value


def recall(params: RecallParams, *logs: Value) -> Value:
    """All surrogates of objects that are asked for, for every class of which an object counts."""
    from lidarplace.recall.baselines import baselines
    from lidarplace.recall.counted_objects import CountedObjects

    start = time.perf_counter()
    if "expected_recall" in params.names:
        model = objects_of(params, logs)
        (seen,) = model.objects.seen_by([params.placement])
        found = model.recall(seen).join(baselines(model.objects, seen), how="inner")
    else:  # the others need no detection curves
        objects = CountedObjects.from_log(
            _training_log(logs),
            params.roi,
            params.classes,
            params.curves.cell,
            frames=params.frames,
            seed=params.seed,
            vehicle=params.vehicle,
        )
        (seen,) = objects.seen_by([params.placement])
        found = baselines(objects, seen)
    table = found[list(params.names)].reset_index().melt("class", var_name="surrogate")
    return {"table": table.assign(method="raycast", seconds=time.perf_counter() - start)}


def requirements(params: RequirementsParams) -> Value:
    """What becomes of each requirement under a rig, and by its number the ground of `Ground`."""
    from lidarplace.requirements.ground import Ground
    from lidarplace.requirements.judge import judge
    from lidarplace.requirements.layout import lay_out
    from lidarplace.requirements.tables import case_table

    laid = [lay_out(own, params.vehicle) for own in params.requirements]
    outcomes = judge(laid, params.placement, params.vehicle)
    value: Value = {"table": case_table(outcomes)}
    for number, outcome in enumerate(outcomes):
        ground = Ground.of(outcome)
        value |= {f"x_{number}": ground.x, f"y_{number}": ground.y}
        value[f"least_{number}"] = ground.least.astype(np.float32)
    return value


def accuracy(params: AccuracyParams, *logs: Value) -> Value:
    """Surrogates of one class against seconds: methods, resolutions, azimuth steps, frames."""
    from lidarplace.pog.surrogates.error_against_time import accuracy as compare

    log = _training_log(logs)
    table = compare(
        log.boxes,
        log.frames,
        params.roi,
        [params.object_class],
        [params.placement],
        resolutions=params.resolutions,
        azimuth_steps=params.azimuth_steps,
        frame_shares=params.frame_shares,
        detection_probability=params.detection_probability,
        occlusion=params.occlusion,
        surrogates=params.names,
    )
    return {"table": table.drop(columns="placement")}


def sampling_error(params: SamplingErrorParams, *logs: Value) -> Value:
    """Intervals of the surrogates: the frames of the POG drawn again in blocks.

    Empty for a single frame, which has no spread.
    """
    from lidarplace.pog.surrogates.sampling_error import pog_sampling_error

    log = _training_log(logs)
    if len(log.frames) < 2:
        return {"estimates": pd.DataFrame(), "resamples": pd.DataFrame()}
    found = pog_sampling_error(
        log.boxes,
        log.frames,
        params.roi,
        params.classes,
        params.placement,
        params.method,
        detection_probability=params.detection_probability,
        occlusion=params.occlusion,
        surrogates=params.names,
    )
    return {"estimates": found.estimates, "resamples": found.resamples}


def collect(params: CollectParams | RecordedParams, log: Value) -> Value:
    """Point clouds of one split under one placement, and the points on every object."""
    from lidarplace.clouds.points_in_boxes import count_points_per_object
    from lidarplace.clouds.recorded import clouds_digest, recorded_clouds

    recorded = box_log(log)
    if isinstance(params, RecordedParams):
        if clouds_digest(params.folder) != params.digest:
            raise ValueError(
                f"{params.folder}: the clouds have changed since the command was given; give the "
                "command again"
            )
        numbers = _frames_of(recorded, params.split)
        clouds = recorded_clouds(params.folder, numbers, params.crop)
    else:
        clouds = _simulated(params, recorded).kept()
    return clouds.arrays() | {"points_per_object": count_points_per_object(recorded.boxes, clouds)}


def probe(params: ProbeParams, *inputs: Value) -> Value:
    """What a step of a training needs: frames in it, and the share of a GPU's memory.

    Parameters and inputs as of the training.
    """
    from training.probe import probe as probe_training

    clouds, objects = _clouds_and_objects(inputs)
    found = probe_training(
        params.detector,
        params.classes,
        clouds,
        objects,
        params.training,
        point_range=params.point_range,
        gpu_share=params.gpu_share or 1.0,
        typical=params.typical,
    )
    return {"batch_size": found.batch_size, "gpu_share": found.gpu_share}


def finetune(
    params: TrainingParams,
    *inputs: Value,
    **how: Any,
) -> Value:
    """Train one detector on the clouds of one placement.

    From scratch it is trained for the classes that occur; heads that are there already stay.

    Args:
        params: the network, how to train it, and the seed.
        inputs: clouds, and the objects in them; before them a generalist to start from, if any.
        how: see `_train`.
    """
    from training.dataset import occurring_classes

    clouds, objects = _clouds_and_objects(inputs)
    generalist = next((value["state_dict"] for value in inputs if "state_dict" in value), None)
    classes = params.classes
    if params.training.checkpoint is None and generalist is None:
        share = params.training.frame_share
        classes = occurring_classes(classes, clouds, objects, share)
    return _train(params, classes, clouds, objects, generalist, **how)


def pretrain(
    params: TrainingParams,
    *inputs: Value,
    **how: Any,
) -> Value:
    """Train one detector on the clouds of many placements, for all classes.

    Arguments as of `finetune`, which starts from the result.
    """
    clouds, objects = _clouds_and_objects(inputs)
    return _train(params, params.classes, clouds, objects, None, **how)


def evaluate(params: NetworkParams, weights: Value, *inputs: Value) -> Value:
    """Detect on the test clouds and compare with the ground truth. `inputs` as for `finetune`."""
    from training.by_distance import evaluate_by_distance
    from training.by_sector import recall_by_sector
    from training.detect import detect
    from training.kitti_ap import evaluation

    clouds, objects = _clouds_and_objects(inputs)
    found = detect(
        params.detector,
        weights["classes"],
        weights["state_dict"],
        clouds,
        params.training,
        point_range=params.point_range,
        typical=params.typical,
    )
    frames = clouds.frames.tolist()
    classes, ious = params.classes, dict(params.ious)
    routes = pd.concat([value["frames"] for value in inputs if "objects" in value])
    routes = routes[routes["frame"].isin(frames)]
    whole = evaluation(
        objects, found.boxes, frames, classes, found.refined, routes, ious, params.metrics
    )
    return {
        "metrics": whole.metrics,
        "pr_curves": whole.curves,
        "left_out": whole.left_out,
        "by_distance": evaluate_by_distance(objects, found.boxes, frames, classes, ious),
        "by_sector": recall_by_sector(whole.objects, ious),
        "detections": found.boxes,
    }


def judge(params: JudgeParams, weights: Value, *inputs: Value) -> Value:
    """Detections of a rig in some test frames: its clouds are simulated, looked at and forgotten.

    Args:
        params: the network, and the rig and the frames.
        weights: result of a training.
        inputs: logs.
    """
    from training.detect import detect

    clouds = [_simulated(params.collection, box_log(log)) for log in inputs]
    found = detect(
        params.detector,
        weights["classes"],
        weights["state_dict"],
        JoinedClouds(clouds),
        params.training,
        point_range=params.point_range,
        typical=params.typical,
    )
    frames = np.concatenate([cloud.frames for cloud in clouds])
    return {"detections": found.boxes, "frames": pd.DataFrame({"frame": frames})}


FUNCTIONS: dict[str, Callable[..., Value]] = {
    "scene": scene,
    "ground_truth": ground_truth,
    "pog": pog,
    "surrogates": surrogates,
    "recall": recall,
    "requirements": requirements,
    "accuracy": accuracy,
    "sampling_error": sampling_error,
    "collect": collect,
    "probe": probe,
    "pretrain": pretrain,
    "finetune": finetune,
    "evaluate": evaluate,
    "judge": judge,
}
"""Stages by name, which is that of the function, in the order in which results flow."""


def box_log(value: Value) -> BoxLog:
    """The box log in a result of `scene`."""
    return BoxLog(value["boxes"], value["frames"], value["buildings"])


def _training_log(logs: Sequence[Value]) -> BoxLog:
    """The training split, from which surrogates are."""
    log = join_logs([box_log(value) for value in logs])
    frames = log.frames[log.frames["split"] == "train"]
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])]
    return BoxLog(boxes, frames, log.buildings)


def _frames_of(log: BoxLog, split: str) -> NDArray[np.int64]:
    """Numbers of the frames of a split."""
    return log.frames.loc[log.frames["split"] == split, "frame"].to_numpy(np.int64)


def _simulated(params: CollectParams, log: BoxLog) -> SimulatedClouds:
    """Clouds of the frames that the parameters name, as they are asked for."""
    from lidarplace.clouds.collect import SimulatedClouds

    return SimulatedClouds(
        log,
        _frames_of(log, params.split)[params.first :: params.every],
        params.placement,
        crop=params.crop,
        seed=params.seed,
        misaligned_heights=params.misaligned_heights,
        errors=params.errors,
        vehicle=params.vehicle,
    )


def _clouds_and_objects(inputs: Sequence[Value]) -> tuple[Clouds, pd.DataFrame]:
    """Clouds, and the objects that are in their frames: results of `collect` and `ground_truth`."""
    truths = [value["objects"] for value in inputs if "objects" in value]
    clouds = [PointClouds.from_arrays(value) for value in inputs if "offsets" in value]
    objects = pd.concat(truths, ignore_index=True)
    joined = JoinedClouds(clouds)
    return joined, objects[objects["frame"].isin(joined.frames)]


def _train(
    params: TrainingParams,
    classes: Sequence[str],
    clouds: Clouds,
    objects: pd.DataFrame,
    generalist: Mapping[str, Tensor] | None,
    folder: Path,
    batch_size: int | None,
    halvings: int,
    on_step: Callable[[float], None],
) -> Value:
    """Train one detector.

    Args:
        generalist: weights to start from.
        folder: where it goes on after a stop.
        batch_size: frames of a step where the settings leave it open; None: it is found out.
        halvings: how often the batch size is halved, after the GPU's memory was too small.
        on_step: called with the epochs that are done.
    """
    from training.batch_size import Memory
    from training.finetune import StartingWeights
    from training.finetune import finetune as train

    result = train(
        params.detector,
        classes,
        clouds,
        objects,
        params.training,
        seed=params.seed,
        point_range=params.point_range,
        on_step=on_step,
        folder=folder,
        start=StartingWeights(digest=params.checkpoint, generalist=generalist),
        memory=Memory(batch_size, halvings),
        typical=params.typical,
    )
    value = {
        "state_dict": result.state_dict,
        "curve": result.curve,
        "classes": list(classes),
        "batch_size": result.batch_size,
        "batch_size_reduced": result.batch_size_reduced,
        "weights": result.weights,
        "earlier_seconds": result.earlier_seconds,
    }
    if result.best_state_dict is not None:
        value["best_state_dict"] = result.best_state_dict
    return value


def objects_of(
    params: RecallParams, logs: Sequence[Value], azimuth_share: float = 1.0
) -> ExpectedRecall:
    """The objects of which `recall` is; `azimuth_share` of the azimuth steps of rigs are cast."""
    from lidarplace.recall.expected_recall import ExpectedRecall

    return ExpectedRecall.from_log(
        _training_log(logs),
        params.roi,
        params.classes,
        params.curves,
        frames=params.frames,
        azimuth_share=azimuth_share,
        seed=params.seed,
        vehicle=params.vehicle,
    )


@cached(
    LRUCache(maxsize=1),
    # The grids keep these arrays, so that no others can have their places.
    key=lambda pog: tuple(id(pog[f"counts_{name}"]) for name in pog["classes"]),
)
def grids_of(pog: Value) -> dict[str, OccupancyGrid]:
    """The grids in a result of `pog`; those of the last one are kept, with all they work out."""
    roi, frames = Roi(**pog["roi"]), pog["frames"]
    return {
        name: OccupancyGrid(roi, name, pog[f"counts_{name}"], frames) for name in pog["classes"]
    }

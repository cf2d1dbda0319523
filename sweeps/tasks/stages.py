"""The stages of a sweep: functions from parameters and earlier results to a result.

They know nothing of Ray, of the store or of the grid.

scene -> ground_truth, pog -> surrogates
scene -> recall, accuracy, sampling_error
requirements, which need no scene
scene -> collect -> finetune -> evaluate
scene -> collect -> pretrain (-> finetune) -> evaluate
scene -> collect -> evaluate, by pretrained weights
scene -> collect -> command -> measure: a program of the user's own in place of a training
scene -> judge, by a trained detector: collect and evaluate without anything kept between them

A scene may be recorded in parts; `*logs` are all of them. Where inputs are of several stages they
are distinguished by their types.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar, Unpack

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace import OccupancyGrid, evaluate_classes
from lidarplace.base.errors import InputError
from lidarplace.base.foreign_code import foreign_code
from lidarplace.base.metrics import Overlaps
from lidarplace.clouds.clouds import Clouds, Frames, JoinedClouds, PointClouds
from lidarplace.logs.box_log import BoxLog, join_logs
from lidarplace.pog.surrogates.evaluate import linear_share
from lidarplace.pog.surrogates.sampling_error import SamplingError, pog_sampling_error
from lidarplace.pog.surrogates.table import SURROGATES, to_ask_for
from sweeps import PACKAGES
from sweeps.tasks.parameters import (
    AccuracyParams,
    CollectParams,
    CommandParams,
    GroundTruthParams,
    JudgeParams,
    MeasureParams,
    NetworkParams,
    PogParams,
    PretrainedParams,
    PretrainParams,
    RecallParams,
    RecordedParams,
    RequirementsParams,
    SamplingErrorParams,
    SceneParams,
    SurrogateParams,
    TrainingParams,
)
from sweeps.tasks.results import (
    Accuracy,
    Collected,
    Evaluated,
    GroundTruth,
    Judged,
    Pog,
    Required,
    Scores,
    Trained,
)

if TYPE_CHECKING:
    from torch import Tensor

    from lidarplace.clouds.collect import SimulatedClouds
    from lidarplace.recall.expected_recall import ExpectedRecall
    from training.detect import Detections

T = TypeVar("T")


class How(TypedDict):
    """How a training runs. `folder`: where it goes on after a stop. `halvings`: how often the batch
    size is halved, after the GPU's memory was too small. `on_step`: called with the epochs that are
    done."""

    folder: Path
    halvings: int
    on_step: Callable[[float], None]


def scene(params: SceneParams) -> BoxLog:
    """Simulate a part of a scene, or read it."""
    kind = type(params.recording)
    if kind.__module__.partition(".")[0] in PACKAGES:
        return params.recording.record()
    with foreign_code(f"{kind.__module__}.{kind.__qualname__}", (Exception,)):
        return params.recording.record()


def ground_truth(params: GroundTruthParams, log: BoxLog) -> GroundTruth:
    """Objects of every frame that count, the same for every placement, and all frames."""
    from lidarplace.clouds.visibility import ground_truth as visible_objects

    objects = visible_objects(log, params.x, params.y, params.z, seed=params.seed)
    return GroundTruth(objects, log.frames[["scene", "frame", "route", "split"]])


def pog(params: PogParams, *logs: BoxLog) -> Pog:
    """Occupancy by every class over the frames of the training split. Test frames stay out: a
    surrogate predicts how a placement will do on what was not seen."""
    roi, log = params.roi, _training_log(logs)
    frames = len(log.frames)
    grids = OccupancyGrid.by_class(log.boxes, roi, params.classes, frames=frames)
    # Not `grid.entropy`, which is twice as large as the counts and stays.
    sums = {
        name: [grid.entropy_of_count[counts].sum(axis=1) for counts in grid.counts]
        for name, grid in grids.items()
    }
    from_above = {name: np.array(own, np.float32) for name, own in sums.items()}
    counts = {name: grid.counts for name, grid in grids.items()}
    return Pog(list(grids), frames, roi, counts, from_above)


def surrogates(params: SurrogateParams, pog: Pog) -> Scores:
    """All surrogates of the POG that are asked for, for every class."""
    grids, names, q = grids_of(pog), params.names, params.detection_probability
    rows = []
    if names:
        results = evaluate_classes(
            grids,
            params.placement,
            method=params.method,
            surrogates=to_ask_for(names),
            detection_probability=q,
            occlusion=params.occlusion,
        )
        shown = (*names, *(n for n, own in SURROGATES.own.items() if own.beside in names))
        rows = [
            (object_class, name, result[name], params.method, result.seconds)
            for object_class, result in results.items()
            for name in shown
        ]
    columns = ["class", "surrogate", "value", "method", "seconds"]
    table = pd.DataFrame(rows, columns=columns).astype({"value": float, "seconds": float})
    if "expected_ig" in names:
        share = table["class"].map(linear_share(grids, params.placement, q))
        table["linear_share"] = share.where(table["surrogate"] == "expected_ig")
    return Scores(table)


def recall(params: RecallParams, *logs: BoxLog) -> Scores:
    """All surrogates of objects that are asked for, for every class of which an object counts."""
    from lidarplace.recall.baselines import baselines
    from lidarplace.recall.counted_objects import CountedObjects

    start = time.perf_counter()
    if "expected_recall" in params.names:
        model = objects_of(params, logs)
        found = _mean_over(
            model.recall(seen).join(baselines(model.objects, seen), how="inner")
            for seen in model.objects.seen_by(params.rigs)
        )
    else:  # the others need no detection curves
        own = (_training_log(logs), params.roi, params.classes, params.curves.cell)
        objects = CountedObjects.from_log(*own, **_counted(params))
        found = _mean_over(baselines(objects, seen) for seen in objects.seen_by(params.rigs))
    table = found[list(params.names)].reset_index().melt("class", var_name="surrogate")
    return Scores(table.assign(method="raycast", seconds=time.perf_counter() - start))


def _mean_over(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    found = list(tables)
    return found[0] if len(found) == 1 else pd.concat(found).groupby(level=0, sort=False).mean()


def requirements(params: RequirementsParams) -> Required:
    """What becomes of each requirement under a rig, and by its number the ground of `Ground`."""
    from lidarplace.requirements.check_requirements import check_requirements
    from lidarplace.requirements.layout import lay_out
    from lidarplace.requirements.tables import Ground, case_table

    laid = [lay_out(own, params.vehicle) for own in params.requirements]
    outcomes = check_requirements(laid, params.placement, params.vehicle, params.further)
    grounds = {str(number): Ground.of(outcome) for number, outcome in enumerate(outcomes)}
    return Required(
        case_table(outcomes),
        x={number: ground.x for number, ground in grounds.items()},
        y={number: ground.y for number, ground in grounds.items()},
        least={number: ground.least.astype(np.float32) for number, ground in grounds.items()},
    )


def accuracy(params: AccuracyParams, *logs: BoxLog) -> Accuracy:
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
    return Accuracy(table.drop(columns="placement"))


def sampling_error(params: SamplingErrorParams, *logs: BoxLog) -> SamplingError:
    """Intervals of the surrogates: the frames of the POG drawn again in blocks; empty for one."""
    log = _training_log(logs)
    if len(log.frames) < 2:
        return SamplingError(pd.DataFrame(), pd.DataFrame())
    return pog_sampling_error(
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


def collect(params: CollectParams | RecordedParams, log: BoxLog) -> Collected:
    """Point clouds of one split under one placement, and the points on every object."""
    from lidarplace.clouds.points_in_boxes import count_points_per_object
    from lidarplace.clouds.recorded import clouds_digest, recorded_clouds

    if isinstance(params, RecordedParams):
        if clouds_digest(params.folder) != params.digest:
            problem, fix = "the clouds have changed since the start", "run the command again"
            raise InputError(problem, place=params.folder, fix=fix)
        numbers, kept = _frames_of(log, params.split), None
        if params.rig is not None:
            kept = [n for n, name in enumerate(params.rig.names) if name in params.lidars]
        clouds = recorded_clouds(params.folder, numbers, params.crop, kept)
    else:
        clouds = _simulated(params, log).kept()
    counts = count_points_per_object(log.boxes, clouds)
    return Collected(**clouds.arrays(), points_per_object=counts)


def finetune(
    params: TrainingParams, *inputs: Trained | Collected | GroundTruth, **how: Unpack[How]
) -> Trained:
    """Train one detector on the clouds of one placement. From scratch it is trained for the classes
    that occur; heads that are there already stay. `inputs` are clouds, the objects in them, and a
    generalist to start from, if any."""
    from training.dataset import occurring_classes

    clouds, objects = _clouds_and_objects(inputs)
    generalist = next((own.state_dict for own in _of(Trained, inputs)), None)
    classes, settings = params.classes, params.training
    if settings.checkpoint is None and generalist is None:
        classes = occurring_classes(classes, clouds, objects, settings.frame_share)
    return _train(params, classes, clouds, objects, generalist, how)


def pretrain(
    params: PretrainParams, *inputs: Collected | GroundTruth, **how: Unpack[How]
) -> Trained:
    """Train one detector on the clouds of many placements, scene by scene, for all classes."""
    clouds, objects = _clouds_and_objects(inputs, params.scenes)
    return _train(params, params.classes, clouds, objects, None, how)


def pretrained(params: PretrainedParams) -> Trained:
    """The generalist of a file. Raises ValueError if it is not the one that was planned with."""
    from training.pretrained import read_generalist

    found = read_generalist(params.path)
    if found.digest != params.digest:
        raise InputError("the checkpoint has changed since the start", place=params.path)
    origin = f"{params.path.name} sha256:{found.digest[:12]}"
    curve = pd.DataFrame(columns=["epoch", "metric", "value"])
    return Trained(found.state_dict, curve, found.classes, 1, False, origin, 0.0)


def evaluate(
    params: NetworkParams, weights: Trained, *inputs: Collected | GroundTruth
) -> Evaluated:
    """Detect on the test clouds and compare with the ground truth."""
    clouds, objects = _clouds_and_objects(inputs)
    found = _detections(params, weights, clouds)
    routes = pd.concat([truth.frames for truth in _of(GroundTruth, inputs)])
    routes = routes[routes["frame"].isin(clouds.frames)]
    asked = (params.classes, dict(params.ious), found.refined, params.metrics)
    return evaluated(objects, found.boxes, routes, *asked)


def command(params: CommandParams, *inputs: BoxLog | Collected | GroundTruth) -> Judged:
    """Detections of a command in the test frames, of which it has no labels, from logs, clouds and
    objects of all frames."""
    from sweeps.tasks.command import detected_by

    clouds, objects = _clouds_and_objects(inputs)
    frames = pd.concat([log.frames for log in _of(BoxLog, inputs)])
    return detected_by(params, frames, objects[objects["class"].isin(params.classes)], clouds)


def measure(params: MeasureParams, found: Judged, *truths: GroundTruth) -> Evaluated:
    tables = ([own.objects for own in truths], [own.frames for own in truths])
    whole = (pd.concat(table, ignore_index=True) for table in tables)
    objects, routes = (table[table["frame"].isin(found.frames["frame"])] for table in whole)
    asked = (params.classes, dict(params.ious), None, params.metrics)
    return evaluated(objects, found.detections, routes, *asked)


def judge(params: JudgeParams, weights: Trained, *logs: BoxLog) -> Judged:
    """Detections of a rig in some test frames: its clouds are made, looked at and forgotten."""
    clouds = [_simulated(params.collection, log) for log in logs]
    found = _detections(params, weights, JoinedClouds(clouds))
    frames = np.concatenate([cloud.frames for cloud in clouds])
    return Judged(found.boxes, pd.DataFrame({"frame": frames}))


_STAGES: tuple[Callable[..., Any], ...] = (
    *(scene, ground_truth, pog, surrogates, recall, requirements, accuracy, sampling_error),
    *(collect, pretrain, pretrained, finetune, evaluate, command, measure, judge),
)
FUNCTIONS = {stage.__name__: stage for stage in _STAGES}
"""Stages by name, in the order in which results flow."""


def _of(kind: type[T], inputs: Iterable[object]) -> list[T]:
    return [own for own in inputs if isinstance(own, kind)]


def _training_log(logs: Sequence[BoxLog]) -> BoxLog:
    log = join_logs(logs)
    frames = log.frames[log.frames["split"] == "train"]
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])]
    return replace(log, boxes=boxes, frames=frames)


def _frames_of(log: BoxLog, split: str) -> NDArray[np.int64]:
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


def _clouds_and_objects(
    inputs: Sequence[object], scenes: Sequence[int] = ()
) -> tuple[Clouds, pd.DataFrame]:
    """Clouds, and the objects that are in their frames. `scenes` is how many of the inputs each
    scene has, whose frames are numbered on from those of the scene before; by default all inputs
    are of one scene."""
    left = iter(inputs)
    clouds: list[Collected] = []
    objects: list[pd.DataFrame] = []
    first = 0
    for number in scenes or (len(inputs),):
        own = tuple(islice(left, number))
        found = [replace(cloud, frames=cloud.frames + first) for cloud in _of(Collected, own)]
        frames = JoinedClouds[PointClouds](found).frames
        truth = pd.concat([truth.objects for truth in _of(GroundTruth, own)], ignore_index=True)
        truth["frame"] += first
        objects.append(truth[truth["frame"].isin(frames)])
        clouds += found
        first = 1 + int(frames.max(initial=-1))
    return JoinedClouds[PointClouds](clouds), pd.concat(objects, ignore_index=True)


def _detections(params: NetworkParams, weights: Trained, clouds: Frames) -> Detections:
    from training.detect import detect

    network = (params.detector, weights.classes, weights.state_dict)
    return detect(*network, clouds, params.training, params.point_range, params.typical)


def evaluated(
    objects: pd.DataFrame,
    found: pd.DataFrame,
    routes: pd.DataFrame,
    classes: Sequence[str],
    ious: Mapping[str, Overlaps],
    refined: pd.DataFrame | None = None,
    metrics: Sequence[str] = (),
) -> Evaluated:
    """Compare detections, columns of `training.detect.Detections`, whoever made them, with the
    objects that count; by scene, frame and route of the frames, and further metrics of plug-ins."""
    from training.by_place import evaluate_by_distance, recall_by_sector
    from training.kitti_ap import evaluation

    frames = routes["frame"].tolist()
    whole = evaluation(objects, found, routes, classes, refined, ious, metrics)
    assert whole.left_out is not None  # routes are given
    return Evaluated(
        metrics=whole.metrics,
        pr_curves=whole.curves,
        left_out=whole.left_out,
        by_distance=evaluate_by_distance(objects, found, frames, classes, ious),
        by_sector=recall_by_sector(whole.objects, ious),
        detections=found,
    )


def _train(
    params: TrainingParams,
    classes: Sequence[str],
    clouds: Clouds,
    objects: pd.DataFrame,
    generalist: Mapping[str, Tensor] | None,
    how: How,
) -> Trained:
    from training.finetune import TrainingRun
    from training.finetune import finetune as train

    place = (params.point_range, params.typical)
    run = TrainingRun(*place, digest=params.checkpoint, generalist=generalist, **how)
    data = (clouds, objects, params.training)
    result = train(params.detector, classes, *data, params.seed, run)
    return Trained(
        state_dict=result.state_dict,
        curve=result.curve,
        classes=list(classes),
        batch_size=result.batch_size,
        batch_size_reduced=result.batch_size_reduced,
        weights=result.weights,
        earlier_seconds=result.earlier_seconds,
    )


def objects_of(
    params: RecallParams, logs: Sequence[BoxLog], azimuth_share: float = 1.0
) -> ExpectedRecall:
    """The objects of which `recall` is; `azimuth_share` of the azimuth steps of rigs are cast."""
    from lidarplace.recall.expected_recall import ExpectedRecall

    own = (_training_log(logs), params.roi, params.classes, params.curves)
    return ExpectedRecall.from_log(*own, azimuth_share=azimuth_share, **_counted(params))


def _counted(params: RecallParams) -> dict[str, Any]:
    return {"frames": params.frames, "seed": params.seed, "vehicle": params.vehicle}


@lru_cache(maxsize=1)
def grids_of(pog: Pog) -> dict[str, OccupancyGrid]:
    """The grids of a POG; those of the last one are kept, with all they work out."""
    return {
        name: OccupancyGrid(pog.roi, name, pog.counts[name], pog.frames) for name in pog.classes
    }

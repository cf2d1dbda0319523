"""The stages that detect by a network, and compare with the ground truth."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pandas as pd
from cachetools import LRUCache, cached

from lidarplace.base.metrics import METRICS
from lidarplace.clouds.clouds import CloudFrames, JoinedClouds
from lidarplace.logs.box_log import BoxLog
from sweeps.stages.collect import CollectedClouds, CollectStage, clouds_and_objects
from sweeps.stages.ground_truth import GroundTruth
from sweeps.stages.measure import (
    EVALUATION_TABLES,
    DetectedFrames,
    EvaluationResult,
    evaluate_detections,
)
from sweeps.stages.stage import R, of_type
from sweeps.stages.train import Network, TrainedDetector

if TYPE_CHECKING:
    from training.detect import Detections, Predictor


@dataclass(frozen=True)
class EvaluateStage(Network[EvaluationResult]):
    """Detect on the test clouds and compare with the ground truth."""

    name = "evaluate"
    order = 20
    ends_trial = True
    tables: ClassVar = EVALUATION_TABLES
    plugins: ClassVar = {"metrics": METRICS}

    def run(
        self, weights: TrainedDetector, *inputs: CollectedClouds | GroundTruth
    ) -> EvaluationResult:
        clouds, objects = clouds_and_objects(inputs)
        detections = _detect(self, weights, clouds)
        routes = pd.concat([truth.frames for truth in of_type(GroundTruth, inputs)])
        routes = routes[routes["frame"].isin(clouds.frames)]
        settings = (self.classes, dict(self.ious), detections.refined, self.metrics)
        return evaluate_detections(objects, detections.boxes, routes, *settings)


@dataclass(frozen=True)
class DetectStage(Network[DetectedFrames]):
    """Detect on some test frames of a rig, whose clouds are simulated one by one and not kept."""

    collection: CollectStage

    name = "detect"
    order = 10
    ends_trial = True

    def run(self, weights: TrainedDetector, *logs: BoxLog) -> DetectedFrames:
        clouds = [self.collection.simulated(log) for log in logs]
        detections = _detect(self, weights, JoinedClouds(clouds))
        frames = np.concatenate([cloud.frames for cloud in clouds])
        return DetectedFrames(detections.boxes, pd.DataFrame({"frame": frames}))


def _detect(stage: Network[R], weights: TrainedDetector, clouds: CloudFrames) -> Detections:
    _, predictor = _predictor(stage, weights)
    return predictor.detect(clouds)


def _settings(stage: Network[R], weights: TrainedDetector) -> Hashable:
    settings = stage.training.model_dump_json()
    return id(weights), stage.detector, settings, stage.point_range, stage.typical


@cached(LRUCache(maxsize=1), key=_settings)
def _predictor(stage: Network[R], weights: TrainedDetector) -> tuple[TrainedDetector, Predictor]:
    """Return the network on its device, and its weights; successive tasks often share them."""
    from training.detect import Predictor

    network = (stage.detector, weights.classes, weights.state_dict)
    return weights, Predictor(*network, stage.training, stage.point_range, stage.typical)

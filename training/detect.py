"""Run a trained detector on point clouds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from lidarplace.clouds.clouds import CloudFrames
from lidarplace.logs.boxes import GEOMETRY
from training.casting import points_on
from training.detectors.build import build
from training.detectors.contract import as_arrays, check_boxes_of, guarded, is_built_in
from training.detectors.detector import PointRange
from training.device import device, half_type
from training.prediction_batches import PredictionBatches
from training.settings import TrainingSettings
from training.typical_objects import TypicalObject

BoxArrays = dict[str, NDArray[np.generic]]
"""Boxes, scores and labels of a frame, see `as_arrays`."""


@dataclass(frozen=True)
class Detections:
    """Boxes of a detector; ego frame, metres and radians."""

    boxes: pd.DataFrame  # frame, class, x, y, z, length, width, height, yaw, score
    # The same, but for class and score, of all boxes of the second stage before any is dropped
    refined: pd.DataFrame | None


def detect(
    detector: str,
    classes: Sequence[str],
    state_dict: Mapping[str, Tensor],
    clouds: CloudFrames,
    settings: TrainingSettings,
    point_range: PointRange | None = None,
    typical: Sequence[TypicalObject] = (),
) -> Detections:
    """Detect objects in all frames of `clouds`.

    Takes what `finetune` took and returned; `classes` are those of the network."""
    return Predictor(detector, classes, state_dict, settings, point_range, typical).detect(clouds)


class Predictor:
    """A trained network on its device, for the clouds of one rig after the other.

    Arguments as of `detect`. On a GPU memory is measured with the first clouds."""

    def __init__(
        self,
        detector: str,
        classes: Sequence[str],
        state_dict: Mapping[str, Tensor],
        settings: TrainingSettings,
        point_range: PointRange | None = None,
        typical: Sequence[TypicalObject] = (),
    ) -> None:
        self._model = model = build(detector, classes, point_range=point_range, typical=typical)
        model.load_state_dict(state_dict)
        if is_built_in(model):  # others may call layers one by one
            fold_batch_norm(model)
        model.to(device()).eval()
        self._classes = np.array(list(classes), dtype=object)
        self._half = half_type(model.device, settings.mixed_precision, predicting=True)
        preset = model.selection
        score = preset.score if settings.score_threshold is None else settings.score_threshold
        threshold = preset.nms if settings.nms_threshold is None else settings.nms_threshold
        self._selection = replace(preset, score=score, nms=threshold)
        self._batches = PredictionBatches(model.device, settings.batch_size)

    def detect(self, clouds: CloudFrames) -> Detections:
        """Detect objects in all frames of `clouds`."""
        frames = self._batches.results(partial(self._predict, clouds), len(clouds))
        boxes = self._table(clouds, frames, "boxes")
        check_boxes_of(self._model, boxes)
        labels = np.concatenate([np.zeros(0, np.int64), *(item["labels"] for item in frames)])
        boxes.insert(1, "class", self._classes[labels - 1])
        boxes["score"] = np.concatenate([np.zeros(0), *(item["scores"] for item in frames)])
        two_stages = bool(frames) and "refined" in frames[0]
        return Detections(boxes, self._table(clouds, frames, "refined") if two_stages else None)

    def _predict(self, clouds: CloudFrames, batch: range) -> list[BoxArrays]:
        """Predict the boxes of some frames, as arrays."""
        model = self._model
        points = points_on(model.device, clouds, batch)
        for cloud in points:
            cloud[:, 2] -= model.sensor_height
        autocast = torch.autocast(model.device.type, self._half, enabled=self._half is not None)
        with torch.no_grad(), autocast, guarded(model):
            predictions = model.predict(points, self._selection)
        return as_arrays(model, predictions, [clouds.frames[i] for i in batch])

    def _table(self, clouds: CloudFrames, frames: Sequence[BoxArrays], name: str) -> pd.DataFrame:
        """Return the table of the boxes `name` of all frames."""
        boxes = np.concatenate([np.zeros((0, 7)), *(item[name] for item in frames)])
        boxes[:, 2] += self._model.sensor_height
        rows = pd.DataFrame(boxes, columns=list(GEOMETRY))
        numbers = np.asarray(clouds.frames, np.int64)
        rows.insert(0, "frame", np.repeat(numbers, [len(item[name]) for item in frames]))
        return rows


def fold_batch_norm(model: nn.Module) -> None:
    """Fold batch norm into the 2D convolutions of sequences: convolution, batch norm, ReLU.

    In place, for good: the model then predicts what it did, up to rounding, and cannot be trained.
    ReLUs write over what the convolutions gave them."""
    model.eval()
    for layers in model.modules():
        if not isinstance(layers, nn.Sequential):
            continue
        for index, (layer, norm) in enumerate(pairwise(list(layers))):
            if not isinstance(norm, nn.BatchNorm2d):
                continue
            assert isinstance(layer, nn.Conv2d | nn.ConvTranspose2d)
            transposed = isinstance(layer, nn.ConvTranspose2d)
            layers[index] = fuse_conv_bn_eval(layer, norm, transposed)
            layers[index + 1] = nn.Identity()
            layers[index + 2] = nn.ReLU(inplace=True)

"""Run a trained detector on point clouds."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from lidarplace.boxes import GEOMETRY
from lidarplace.lidar.clouds import Clouds
from training import build_detector
from training.detectors.detector import PointRange, Selection
from training.device import device
from training.settings import TrainingSettings


def detect(
    detector: str,
    classes: Sequence[str],
    state_dict: Mapping[str, Tensor],
    clouds: Clouds,
    settings: TrainingSettings,
    point_range: PointRange | None = None,
) -> pd.DataFrame:
    """Detections in all frames of `clouds`.

    Takes what `finetune` took and returned. Returns columns frame, class, x, y, z, length, width,
    height, yaw, score; ego frame, metres and radians.
    """
    model = build_detector(detector, classes, point_range=point_range)
    model.load_state_dict(state_dict)
    model.to(device())
    lift = np.array([0, 0, model.sensor_height, 0], np.float32)
    frames: list[np.ndarray] = []
    found: list[dict[str, np.ndarray]] = []
    for first in range(0, len(clouds), settings.batch_size):
        batch = range(first, min(first + settings.batch_size, len(clouds)))
        predictions = model.predict(
            [torch.from_numpy(clouds[i] - lift) for i in batch],
            _selection(model.selection, settings),
        )
        for i, item in zip(batch, predictions, strict=True):
            frames.append(np.full(len(item["scores"]), clouds.frames[i]))
            found.append({name: value.cpu().numpy() for name, value in item.items()})
    if not found:
        frames = [np.zeros(0, np.int64)]
        found = [
            {"boxes": np.zeros((0, 7)), "scores": np.zeros(0), "labels": np.zeros(0, np.int64)}
        ]
    boxes = np.concatenate([item["boxes"] for item in found]).astype(np.float64)
    boxes[:, 2] += model.sensor_height
    labels = np.concatenate([item["labels"] for item in found])
    table = pd.DataFrame({"frame": np.concatenate(frames)})
    table["class"] = np.array(list(classes), dtype=object)[labels - 1]
    table[list(GEOMETRY)] = boxes
    table["score"] = np.concatenate([item["scores"] for item in found]).astype(np.float64)
    return table


def _selection(preset: Selection, settings: TrainingSettings) -> Selection:
    """The preset's selection with what the settings name in its place."""
    return dataclasses.replace(
        preset,
        score=preset.score if settings.score_threshold is None else settings.score_threshold,
        nms=preset.nms if settings.nms_threshold is None else settings.nms_threshold,
    )

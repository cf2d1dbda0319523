"""The code of a detector as an MLflow model: points in, boxes out.

MLflow copies this file next to the weights and runs it when the model is loaded; nobody imports it.
It needs lidarplace installed.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from mlflow.models import set_model
from mlflow.pyfunc import PythonModel, PythonModelContext
from numpy.typing import NDArray

from lidarplace.clouds.clouds import valid_points
from training.detect import detect
from training.settings import TrainingSettings
from training.typical_objects import from_plain

POINT = ["x", "y", "z", "intensity"]


class _Clouds:
    """The points of a table by frame."""

    def __init__(self, points: pd.DataFrame) -> None:
        ordered = points.sort_values("frame", kind="stable")
        self.frames, first = np.unique(ordered["frame"].to_numpy(np.int64), return_index=True)
        self._clouds = np.split(ordered[POINT].to_numpy(np.float32), first[1:])

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> np.ndarray:
        return self._clouds[index]


def _check(points: NDArray[np.float64]) -> None:
    """Refuse the `POINT`s that `read_kitti_clouds` refuses; shape (n, 4)."""
    bad = ~valid_points(points)
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(
            f"row {row}: a point must be finite, with an intensity in [0, 1]; found "
            f"{points[row].tolist()} and {int(bad.sum()) - 1} more"
        )


class DetectorModel(PythonModel):  # type: ignore[misc]  # mlflow is not followed
    """Predicts the boxes of every frame."""

    def load_context(self, context: PythonModelContext) -> None:
        """Read weights and settings."""
        self._about = json.loads(Path(context.artifacts["detector"]).read_text())
        self._weights = torch.load(context.artifacts["weights"], weights_only=True)

    def predict(
        self,
        context: PythonModelContext,
        model_input: pd.DataFrame,
        params: dict[str, Any] | None = None,
    ) -> pd.DataFrame:
        """Boxes of the frames in `model_input`; the columns are those of the signature.

        Raises:
            ValueError: a point is not finite or has an intensity outside [0, 1], from which no
                detector has learnt.
        """
        _check(model_input[POINT].to_numpy(np.float64))
        about = self._about
        return detect(
            about["detector"],
            about["classes"],
            self._weights,
            _Clouds(model_input),
            TrainingSettings.model_validate(about["settings"]),
            point_range=tuple(about["point_range"]),
            typical=from_plain(about),
        ).boxes


set_model(DetectorModel())

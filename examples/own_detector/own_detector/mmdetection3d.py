"""A model of MMDetection3D 1.x: `detector: own_detector.mmdetection3d:build`.

Its LiDAR boxes have z at their bottom and its labels start at 0; sizes and yaw are as here.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from training.detectors.detector import Detector, PointRange, Selection
from training.typical_objects import TypicalObject

CONFIG = Path(__file__).with_name("centerpoint.py")
"""A configuration with `model` and `point_cloud_range`, for as many classes as the sweep has."""
SENSOR_HEIGHT = 1.84
"""Of the origin of its range above the ground, metres; nuScenes'."""


class MMDetection3D(Detector):
    """Gives data samples to a model and takes `pred_instances_3d`.

    Args:
        classes: in the order of the model's labels.
        model: of MMDetection3D's registry, with its data preprocessor.
        point_range: what the model sees, in its frame, metres.
        sensor_height: height of the model's origin above the ground, metres.
    """

    def __init__(
        self,
        classes: Sequence[str],
        model: nn.Module,
        point_range: PointRange,
        sensor_height: float,
    ) -> None:
        super().__init__(classes, point_range, sensor_height)
        self.model = model

    def batch(self, points: Sequence[Tensor], samples: Sequence[Any]) -> dict[str, Any]:
        """What the model's data preprocessor makes of points (N, 4): voxels, if it has any."""
        own = [frame.to(self.device) for frame in points]
        data = {"inputs": {"points": own}, "data_samples": list(samples)}
        found: dict[str, Any] = self.model.data_preprocessor(data, self.model.training)
        return found

    def loss(
        self, points: Sequence[Tensor], boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> dict[str, Tensor]:
        """The sum of the model's losses, and each of them."""
        samples = [data_sample(*own) for own in zip(*self.objects(boxes, labels), strict=True)]
        data = self.batch(points, samples)
        losses = self.model.loss(data["inputs"], data["data_samples"])
        total, parts = self.model.parse_losses(losses)
        return {**parts, "loss": total}

    def predict(
        self, points: Sequence[Tensor], selection: Selection | None = None
    ) -> list[dict[str, Tensor]]:
        """Boxes after the model's own NMS, those of a sufficient score."""
        least = (selection or self.selection).score
        none = torch.zeros(0, 7, device=self.device), torch.zeros(0, dtype=torch.int64)
        data = self.batch(points, [data_sample(*none) for _ in points])
        frames = []
        for sample in self.model.predict(data["inputs"], data["data_samples"]):
            found = sample.pred_instances_3d
            good = found.scores_3d >= least
            boxes = found.bboxes_3d.tensor[good, :7].clone()
            boxes[:, 2] += boxes[:, 5] / 2
            labels = found.labels_3d[good] + 1
            frames.append({"boxes": boxes, "scores": found.scores_3d[good], "labels": labels})
        return frames


def data_sample(boxes: Tensor, labels: Tensor) -> Any:
    """A Det3DDataSample with the objects of a frame: boxes (M, 7) and labels (M,) as here."""
    from mmdet3d.structures import Det3DDataSample, LiDARInstance3DBoxes
    from mmengine.structures import InstanceData

    bottom = boxes.clone()
    bottom[:, 2] -= bottom[:, 5] / 2
    sample = Det3DDataSample(metainfo={"box_type_3d": LiDARInstance3DBoxes})
    sample.gt_instances_3d = InstanceData(
        bboxes_3d=LiDARInstance3DBoxes(bottom), labels_3d=labels - 1
    )
    return sample


def build(
    classes: Sequence[str],
    preset: str,
    point_range: PointRange | None,
    typical: Sequence[TypicalObject],
) -> Detector:
    """The model of `CONFIG`; its range is that of the file, not `point_range`."""
    from mmdet3d.registry import MODELS
    from mmengine.config import Config
    from mmengine.registry import init_default_scope

    init_default_scope("mmdet3d")
    config = Config.fromfile(CONFIG)
    model = MODELS.build(config.model)
    return MMDetection3D(classes, model, tuple(config.point_cloud_range), SENSOR_HEIGHT)

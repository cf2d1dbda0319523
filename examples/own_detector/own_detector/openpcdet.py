"""A model of OpenPCDet: `detector: own_detector.openpcdet:build`.

OpenPCDet's own dataset class makes the batches, so voxels are made as its configuration says. Boxes
and labels are as here: centre x, y, z, length, width, height, yaw; labels from 1.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from training.detectors.detector import Detector, PointRange, Selection
from training.typical_objects import TypicalObject

CONFIG = Path(__file__).with_name("pointpillar.yaml")
"""One of OpenPCDet's tools/cfgs, with DATA_CONFIG and MODEL; its CLASS_NAMES are the classes."""
SENSOR_HEIGHT = 1.73
"""Of the origin of its POINT_CLOUD_RANGE above the ground, metres; KITTI's."""


class OpenPCDet(Detector):
    """Gives `batch_dict` to a model and takes `pred_dicts`.

    Args:
        classes: in the order of the model's labels.
        dataset: a DatasetTemplate made with `training=False`: augmentation is done by then.
        model: what `pcdet.models.build_network` made for it.
        sensor_height: height of the model's origin above the ground, metres.
    """

    def __init__(
        self, classes: Sequence[str], dataset: Any, model: nn.Module, sensor_height: float
    ) -> None:
        low_to_high: PointRange = tuple(float(end) for end in dataset.point_cloud_range)
        super().__init__(classes, low_to_high, sensor_height)
        self.model = model
        self._dataset = dataset

    def batch(self, points: Sequence[Tensor], **objects: Sequence[Any]) -> dict[str, Any]:
        """A `batch_dict` on the device of the weights, numbers as OpenPCDet's loader has them."""
        frames = [
            self._dataset.prepare_data(
                {"points": own.numpy(), "frame_id": row}
                | {name: values[row] for name, values in objects.items()}
            )
            for row, own in enumerate(points)
        ]
        numbers = {"points", "gt_boxes", "voxels", "voxel_coords", "voxel_num_points"}
        return {
            name: torch.as_tensor(value).float().to(self.device) if name in numbers else value
            for name, value in self._dataset.collate_batch(frames).items()
        }

    def loss(
        self, points: Sequence[Tensor], boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> dict[str, Tensor]:
        """The model's loss; its `tb_dict` is in the learning curve."""
        names = [[self.classes[label - 1] for label in own.tolist()] for own in labels]
        arrays = [own.numpy() for own in boxes]
        found, parts, _ = self.model(self.batch(points, gt_boxes=arrays, gt_names=names))
        parts = {name: value for name, value in parts.items() if isinstance(value, float | Tensor)}
        return {**parts, "loss": found["loss"].mean()}

    def predict(
        self, points: Sequence[Tensor], selection: Selection | None = None
    ) -> list[dict[str, Tensor]]:
        """Boxes after the model's own NMS, those of a sufficient score."""
        least = (selection or self.selection).score
        found, _ = self.model(self.batch(points))
        return [
            {
                "boxes": own["pred_boxes"][own["pred_scores"] >= least, :7],
                "scores": own["pred_scores"][own["pred_scores"] >= least],
                "labels": own["pred_labels"][own["pred_scores"] >= least],
            }
            for own in found
        ]


def build(
    classes: Sequence[str],
    preset: str,
    point_range: PointRange | None,
    typical: Sequence[TypicalObject],
) -> Detector:
    """The model of `CONFIG`; its range is that of the file, not `point_range`."""
    from pcdet.config import cfg, cfg_from_yaml_file
    from pcdet.datasets import DatasetTemplate
    from pcdet.models import build_network

    cfg_from_yaml_file(str(CONFIG), cfg)
    if list(cfg.CLASS_NAMES) != list(classes):
        raise ValueError(f"{CONFIG.name}: CLASS_NAMES: expected {list(classes)}")
    dataset = DatasetTemplate(cfg.DATA_CONFIG, list(classes), training=False)
    model = build_network(model_cfg=cfg.MODEL, num_class=len(classes), dataset=dataset)
    return OpenPCDet(classes, dataset, model, SENSOR_HEIGHT)

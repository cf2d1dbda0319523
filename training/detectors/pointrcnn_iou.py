"""PointRCNN whose second stage scores a box by the IoU that it should have with its object.

OpenPCDet's tools/cfgs/kitti_models/pointrcnn_iou.yaml: only what the scores learn differs."""

from dataclasses import replace

from training.detectors import pointrcnn
from training.detectors.detector import builder
from training.detectors.pointrcnn import PointRCNN, PointRCNNPreset


def _scored_by_iou(preset: PointRCNNPreset) -> PointRCNNPreset:
    stage = preset.second_stage
    sampling = replace(stage.sampling, score="roi_iou", cls_foreground=0.7, cls_background=0.25)
    return replace(preset, second_stage=replace(stage, sampling=sampling))


PRESETS = {name: _scored_by_iou(preset) for name, preset in pointrcnn.PRESETS.items()}

build = builder(PointRCNN, PRESETS)

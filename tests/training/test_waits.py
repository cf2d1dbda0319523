"""How often the host waits for a GPU in a step of training and in a prediction.

Counted on the device that stands for a GPU: a number that is read, a result whose size depends on
values, a copy in either direction that is not `non_blocking`. The cells that have points, whose
number cannot be known, are of `detectors/backbones` and `ops`, and are not counted."""

import pytest
import torch

from tests.training.other_device import WAITS, other_device
from tests.training.synthetic_scenes import batch
from training import build_detector
from training.detectors.detector import Selection
from training.ops.gpu import rotated_iou
from training.optimisation import Optimisation
from training.settings import TrainingSettings


def waiting(function, *arguments):
    """Names of the files that wait in a call."""
    WAITS.clear()
    function(*arguments)
    counted = (path for path in WAITS if path.parent.name not in ("backbones", "ops", "gpu"))
    return [path.name for path in counted]


@pytest.mark.parametrize("network", ["pointpillars_tiny", "second_tiny"])
def test_one_wait_a_step_and_one_a_prediction(network, monkeypatch):
    monkeypatch.setattr(rotated_iou, "_ROWS", 256)  # a program takes milliseconds on a CPU
    few = Selection(score=0.0, nms=0.1, pre=128, post=20)
    with other_device() as place:
        torch.manual_seed(0)
        model = build_detector(network, ["Car"]).to(place).train()
        optimisation = Optimisation(model, TrainingSettings(mixed_precision=False), steps=2)
        assert waiting(optimisation.step, batch()) == ["optimisation.py"]
        assert waiting(model.predict, batch()[0], few) == ["selection.py"]


def test_waits_are_counted():
    with other_device() as place:
        model = build_detector("pointpillars_tiny", ["Car"]).to(place)
        labels, boxes = [torch.ones(2, dtype=torch.int64)], [torch.zeros(2, 7)]
        assert waiting(model.objects, boxes, labels) == []
        labels = [item.to(place) for item in labels]
        # It reads labels that are on the device.
        assert waiting(model.objects, boxes, labels) == ["detector.py"]

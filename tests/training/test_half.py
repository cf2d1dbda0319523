"""16-bit floats on a CPU: `mixed_precision: everywhere`."""

import numpy as np
import pytest
import torch
from torch.nn import functional

from tests.training.synthetic_scenes import scenes
from training import build_detector, device
from training.dataset import TrainingFrames, as_tensors
from training.detect import detect
from training.optimisation import Optimisation
from training.pretrained import read_generalist
from training.settings import TrainingSettings

pytestmark = pytest.mark.usefixtures("one_thread")

FULL = TrainingSettings(mixed_precision=True)
HALF = TrainingSettings(mixed_precision="everywhere")


@pytest.fixture(scope="module")
def data():
    return scenes(6, seed=1)


@pytest.fixture
def convolved(monkeypatch):
    """Types of the images that convolutions get, and a processor that has bfloat16."""
    monkeypatch.setattr(device, "cpu_has_bfloat16", lambda: True)
    kinds = set()
    linear = functional.linear
    monkeypatch.setattr(
        functional, "linear", lambda rows, *rest: kinds.add(rows.dtype) or linear(rows, *rest)
    )
    return kinds


def detections(clouds, settings):
    """Boxes that the packaged generalist finds."""
    generalist = read_generalist()
    network = (generalist.detector, generalist.classes, generalist.state_dict)
    return detect(*network, clouds, settings).boxes


def test_detections_are_near_those_of_32_bits(data, convolved):
    clouds, truth = data
    full, half = (detections(clouds, settings) for settings in (FULL, HALF))
    assert convolved == {torch.float32, torch.bfloat16}
    sure = full[full["score"] > 0.3]
    assert len(sure) >= len(truth) / 2
    shifts = []
    for box in sure.itertuples():
        same = half[half["frame"] == box.frame]
        distance = np.hypot(same["x"] - box.x, same["y"] - box.y)
        shifts.append((distance.min(), abs(same["score"][distance.idxmin()] - box.score)))
    assert 0 < np.max(shifts) < 0.05, "metres, and score"
    assert half["score"].dtype == full["score"].dtype


def test_a_step_is_near_that_of_32_bits(data, convolved):
    frames = TrainingFrames(["Car"], *data, 0.0, min_points=1)
    losses = []
    for settings in (FULL, HALF):
        torch.manual_seed(0)
        model = build_detector("pointpillars_tiny", ["Car"]).train()
        losses.append(Optimisation(model, settings, 1).step(as_tensors([frames[0], frames[1]])))
        assert {item.dtype for item in model.parameters()} == {torch.float32}
    full, half = losses
    for name, value in full.items():
        assert half[name].dtype == torch.float32
        assert half[name] != value
        assert half[name].item() == pytest.approx(value.item(), rel=0.02)


def test_a_processor_without_bfloat16_says_so(data, monkeypatch, caplog):
    monkeypatch.setattr(device, "cpu_has_bfloat16", lambda: False)
    half = detections(data[0], HALF)
    assert caplog.messages == [device.NO_BFLOAT16]
    assert half.equals(detections(data[0], FULL))
    assert len(caplog.messages) == 1


def test_allowed_values():
    for value in (True, False, "everywhere"):
        assert TrainingSettings(mixed_precision=value).mixed_precision is value

"""Tables of what a network predicts: frames, classes, heights, and boxes of a second stage."""

import numpy as np
import pytest
import torch

from lidarplace.logs.boxes import GEOMETRY
from tests.training.synthetic_scenes import CROP, packed
from training import detect as module
from training.detect import detect
from training.detectors.detector import Detector, Selection
from training.settings import TrainingSettings

CLASSES = ("Car", "Cyclist")


class OneBoxAPoint(Detector):
    """Finds a box at every point, of the class in its intensity, after refining it twice."""

    def __init__(self, two_stages):
        super().__init__(CLASSES, CROP, 1.73, Selection())
        self.two_stages = two_stages
        self.batches = []
        self.selections = []

    def loss(self, points, boxes, labels):
        raise NotImplementedError

    def predict(self, points, selection=None):
        self.batches.append(len(points))
        self.selections.append(selection)
        frames = []
        for cloud in points:
            boxes = torch.cat([cloud[:, :3], torch.ones(len(cloud), 4)], 1)
            frames.append({"boxes": boxes, "scores": torch.arange(len(cloud)) / 10})
            frames[-1]["labels"] = 1 + cloud[:, 3].round().long()
            if self.two_stages:
                frames[-1]["refined"] = boxes.repeat(2, 1)
        return frames


@pytest.fixture
def clouds():
    """Two, no and one point in frames 3, 5 and 8."""
    two, one = np.array([[1, 2, 0.5, 1.0], [3, 4, 1.5, 0.0]]), np.array([[5, 6, 2, 1.0]])
    return packed([3, 5, 8], [two, np.zeros((0, 4)), one])


def run(monkeypatch, clouds, two_stages, **settings):
    model = OneBoxAPoint(two_stages)
    monkeypatch.setattr(module, "build", lambda *args, **kwargs: model)
    state = model.state_dict()
    return model, detect("stub", CLASSES, state, clouds, TrainingSettings(**settings))


def test_boxes_of_every_frame_in_the_ego_frame(monkeypatch, clouds):
    model, detected = run(monkeypatch, clouds, two_stages=False, batch_size=2, score_threshold=0.3)
    assert list(detected.boxes.columns) == ["frame", "class", *GEOMETRY, "score"]
    assert detected.boxes["frame"].tolist() == [3, 3, 8]
    assert detected.boxes["class"].tolist() == ["Cyclist", "Car", "Cyclist"]
    assert detected.boxes["z"].tolist() == pytest.approx([0.5, 1.5, 2.0], abs=2e-3)
    assert detected.boxes["score"].tolist() == pytest.approx([0, 0.1, 0])
    assert detected.refined is None
    assert model.batches == [2, 1]
    assert {selection.score for selection in model.selections} == {0.3}


def test_the_boxes_of_a_second_stage_are_all_there(monkeypatch, clouds):
    model, detected = run(monkeypatch, clouds, two_stages=True, batch_size="auto")
    assert list(detected.refined.columns) == ["frame", *GEOMETRY]
    assert detected.refined["frame"].tolist() == [3, 3, 3, 3, 8, 8]
    assert detected.refined["z"].tolist() == pytest.approx([0.5, 1.5, 0.5, 1.5, 2, 2], abs=2e-3)
    assert model.batches == [3]


def test_no_frames(monkeypatch):
    _, detected = run(monkeypatch, packed([], []), two_stages=True)
    assert list(detected.boxes.columns) == ["frame", "class", *GEOMETRY, "score"]
    assert len(detected.boxes) == 0

"""How often the host waits for a GPU in a step of training and in a prediction.

Counted on the device that stands for a GPU: a number that is read, a result whose size depends on
values, a copy in either direction that is not `non_blocking`. The cells that have points, whose
number cannot be known, are of `detectors/backbones` and `ops`, and are not counted."""

import sys
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

import training
from tests.training.other_device import OtherTensor, other_device
from tests.training.synthetic_scenes import batch
from training import build_detector
from training.detectors.detector import Selection
from training.ops.gpu import rotated_iou
from training.optimisation import Optimisation
from training.settings import TrainingSettings

aten = torch.ops.aten
READS = {
    *(aten._local_scalar_dense, aten.nonzero, aten.masked_select, aten.bincount, aten.equal),
    *(aten.unique_consecutive, aten._unique2, aten.unique_dim, aten.repeat_interleave),
}
ROOT = Path(training.__file__).parent
COPIES = {aten._to_copy, aten.copy_, aten._copy_from}


class Waits(TorchDispatchMode):
    """Files of this package that wait, each as often as it does."""

    def __init__(self):
        super().__init__()
        self.files = []

    def add(self):
        frame = sys._getframe(1)
        while ROOT not in (path := Path(frame.f_code.co_filename)).parents:
            frame = frame.f_back
        if path.parent.name not in ("backbones", "ops", "gpu"):
            self.files.append(path.name)

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):
        out = operation(*args, **(kwargs or {}))
        packet = operation.overloadpacket
        places = {
            isinstance(item, OtherTensor)
            for item in tree_leaves((args, kwargs, out))
            if isinstance(item, torch.Tensor)
        }
        masks = packet in (aten.index, aten.index_put, aten.index_put_) and any(
            index is not None and index.dtype == torch.bool for index in args[1]
        )
        moves = packet in COPIES and len(places) == 2 and not (kwargs or {}).get("non_blocking")
        if True in places and (packet in READS or masks or moves):
            self.add()
        return out


@contextmanager
def counted():
    """Files that wait in the block."""
    read, waits = OtherTensor.tolist, Waits()

    def tolist(tensor):
        waits.add()
        return read(tensor)

    with waits, patch.object(OtherTensor, "tolist", tolist):
        yield waits.files


@pytest.mark.parametrize("network", ["pointpillars_tiny", "second_tiny"])
def test_one_wait_a_step_and_one_a_prediction(network, monkeypatch):
    monkeypatch.setattr(rotated_iou, "_ROWS", 256)  # a program takes milliseconds on a CPU
    few = Selection(score=0.0, nms=0.1, pre=128, post=20)
    with other_device() as place:
        torch.manual_seed(0)
        model = build_detector(network, ["Car"]).to(place).train()
        optimisation = Optimisation(model, TrainingSettings(mixed_precision=False), steps=2)
        with counted() as files:
            optimisation.step(batch())
        assert files == ["optimisation.py"]
        with counted() as files:
            model.predict(batch()[0], few)
        assert files == ["selection.py"]


def test_waits_are_counted():
    with other_device() as place:
        model = build_detector("pointpillars_tiny", ["Car"]).to(place)
        labels, boxes = [torch.ones(2, dtype=torch.int64)], [torch.zeros(2, 7)]
        with counted() as files:
            model.objects(boxes, labels)
        assert files == []
        labels = [item.to(place) for item in labels]
        with counted() as files:
            model.objects(boxes, labels)
        assert files == ["detector.py"]  # it reads labels that are on the device

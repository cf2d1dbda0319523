"""Frames at once: fixed on a CPU, by the memory on a GPU, halved where it was too small."""

import pytest
import torch

from tests.training.other_device import MEMORY, other_device
from training.prediction_batches import LARGEST, MEMORY_SHARE, PredictionBatches

KIB_A_FRAME = 4
COUNT = 150


@pytest.fixture
def device():
    with other_device() as place:
        yield place


@pytest.fixture
def predict(device):
    """Returns the numbers of the frames, each of which takes memory meanwhile."""

    def predict(batch):
        predict.batches.append(len(batch))
        torch.empty(len(batch) * KIB_A_FRAME * 256, device=device)
        return list(batch)

    predict.batches = []
    return predict


def set_free(monkeypatch, frames):
    total = MEMORY.taken + int(frames * KIB_A_FRAME * 1024)
    monkeypatch.setattr(MEMORY, "total", total)


def test_a_cpu_takes_four(predict):
    assert PredictionBatches(torch.device("cpu"), "auto").results(predict, 10) == list(range(10))
    assert predict.batches == [4, 4, 2]


def test_a_gpu_takes_what_its_memory_holds(device, predict, monkeypatch):
    set_free(monkeypatch, 20 / MEMORY_SHARE + 0.5)
    assert PredictionBatches(device, "auto").results(predict, 30) == list(range(30))
    assert predict.batches == [4, 20, 6]
    predict.batches = []
    set_free(monkeypatch, 1000)
    assert PredictionBatches(device, "auto").results(predict, COUNT) == list(range(COUNT))
    assert predict.batches == [4, LARGEST, LARGEST, COUNT - 4 - 2 * LARGEST]


def test_a_process_with_a_share_of_the_gpu_takes_what_that_holds(device, predict, monkeypatch):
    """Other processes may take the rest, which is free now."""
    held = torch.empty(5 * KIB_A_FRAME * 256, device=device)
    monkeypatch.setattr(MEMORY, "total", 100 * MEMORY.taken)
    share = (MEMORY.taken + 10 / MEMORY_SHARE * KIB_A_FRAME * 1024 + 100) / MEMORY.total
    monkeypatch.setattr(MEMORY, "share", share)
    PredictionBatches(device, "auto").results(predict, 24)
    assert predict.batches == [4, 10, 10]
    assert len(held)


def test_memory_that_ends_halves_the_batch_and_is_reported_once(
    device, predict, monkeypatch, caplog
):
    set_free(monkeypatch, 3)
    assert PredictionBatches(device, 16).results(predict, 20) == list(range(20))
    assert predict.batches == [16, 8, 4] + [2] * 10
    assert [record.getMessage() for record in caplog.records] == [
        "other:0: out of memory with 16 frames at once; predicting with smaller batches"
    ]
    set_free(monkeypatch, 0.5)
    with pytest.raises(torch.OutOfMemoryError):
        PredictionBatches(device, "auto").results(predict, 20)

"""The device that stands for a GPU refuses what a GPU refuses, and computes what it would."""

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional

from tests.training.kernels_on_gpu import on_copies
from tests.training.other_device import MEMORY, other_device


@pytest.fixture
def matrix():
    with other_device() as place:
        yield torch.arange(6.0).view(2, 3).to(place)


HERE = torch.ones(2, 3)
MIXED = [
    lambda x: HERE + x,
    lambda x: x[torch.tensor([1, 0])],
    lambda x: HERE[x > 0],
    lambda x: torch.cat([x, HERE]),
    lambda x: x.add_(HERE),
    lambda x: torch.add(x, x, out=torch.empty(2, 3)),
    lambda x: nn.Linear(3, 2)(x),
]


def test_two_devices_in_one_operation_and_numpy_are_errors(matrix):
    for mix in MIXED:
        with pytest.raises(RuntimeError, match="all tensors on other, found one on cpu"):
            mix(matrix)
    for read in (lambda x: x.numpy(), np.asarray, lambda x: torch.sum(x).numpy()):
        with pytest.raises((RuntimeError, TypeError), match="numpy"):
            read(matrix)


def test_autocast(matrix):
    layer = nn.Linear(3, 2).to(matrix.device)
    for dtype in (torch.float16, torch.bfloat16):
        with torch.autocast(matrix.device.type, dtype=dtype):
            rows = layer(matrix)
            assert rows.dtype == dtype
            assert functional.cross_entropy(rows, matrix[:, 1].long() % 2).dtype == torch.float32
            assert (rows + rows).dtype == dtype
            assert layer(matrix.double().float()).dtype == dtype
    assert layer(matrix).dtype == torch.float32


def test_memory_is_counted_and_ends(matrix, monkeypatch):
    before, place = MEMORY.taken, matrix.device
    a = torch.zeros(1000, device=place)
    views = a[10:], a.view(10, 100)
    assert MEMORY.taken == before + 4000
    MEMORY.reset_peak_memory_stats()
    b = a + views[1].flatten()
    del a, b
    assert MEMORY.taken == before + 4000  # of the views
    assert MEMORY.max_memory_reserved() == before + 8000
    monkeypatch.setattr(MEMORY, "total", MEMORY.taken + 4000)
    with pytest.raises(torch.OutOfMemoryError):
        torch.zeros(1001, device=place)
    del views
    assert MEMORY.taken == before


def test_kernels_take_copies_of_cpu_tensors(matrix):
    base = torch.arange(20.0).view(4, 5)
    column, row, empty = base[1:, 2], base[1], torch.empty(0, 3)

    def run(kernel, numbers, target, nothing, elsewhere, factor, *, grid):
        assert (kernel, factor, grid) == ("kernel", 2, (1,))
        assert numbers.stride() == (5,)
        assert nothing.shape == (0, 3)
        assert numbers.untyped_storage().data_ptr() == target.untyped_storage().data_ptr()
        assert numbers.untyped_storage().data_ptr() != base.untyped_storage().data_ptr()
        target[:3] = factor * numbers
        elsewhere += 1
        assert base[1, 0] == 5, "not before the kernel has ended"

    before = matrix.cpu()
    on_copies(run, "cpu")("kernel", column, row, empty, matrix, 2, grid=(1,))
    assert base[1].tolist() == [14, 24, 34, 8, 9]
    assert torch.equal(matrix.cpu(), before + 1)

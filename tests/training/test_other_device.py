"""The device that stands for a GPU refuses what a GPU refuses, and computes what it would."""

import copy

import numpy as np
import pytest
import torch
from other_device import MEMORY, OtherTensor, other_device
from torch import nn
from torch.nn import functional


@pytest.fixture
def place():
    with other_device() as device:
        yield device


@pytest.fixture
def matrix(place):
    return torch.arange(6.0).view(2, 3).to(place)


HERE = torch.ones(2, 3)
MIXED = {
    "sum": lambda x: x + HERE,
    "sum the other way round": lambda x: HERE + x,
    "rows": lambda x: x[torch.tensor([1, 0])],
    "mask": lambda x: x[HERE > 0],
    "part of the CPU's": lambda x: HERE[x > 0],
    "cat": lambda x: torch.cat([x, HERE]),
    "where": lambda x: torch.where(x > 0, x, HERE),
    "in place": lambda x: x.add_(HERE),
    "out": lambda x: torch.add(x, x, out=torch.empty(2, 3)),
    "layer": lambda x: nn.Linear(3, 2)(x),
}


@pytest.mark.parametrize("case", MIXED)
def test_two_devices_in_one_operation(case, matrix):
    with pytest.raises(RuntimeError, match="all tensors on other, found one on cpu"):
        MIXED[case](matrix)


@pytest.mark.parametrize("read", [lambda x: x.numpy(), np.asarray, lambda x: torch.sum(x).numpy()])
def test_numpy_reads_the_cpus_memory_alone(read, matrix):
    with pytest.raises((RuntimeError, TypeError), match="numpy"):
        read(matrix)


def test_what_a_gpu_allows(matrix, place):
    assert matrix.device == place
    assert not matrix.is_cpu
    assert matrix.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert matrix.sum().item() == float(matrix.max() * 3) == 15
    assert f"{matrix.max():.1f}" == "5.0"
    assert bool((matrix >= 0).all())
    assert torch.equal(matrix * torch.tensor(2.0), matrix + matrix)  # a number of the CPU
    for back in (matrix.cpu(), torch.empty(2, 3).copy_(matrix)):
        assert type(back) is torch.Tensor
        assert back.tolist() == matrix.tolist()
    for made in (
        torch.zeros(2, device=place),
        torch.arange(1, 7, 2, device=place),
        torch.tensor([1, 2], device=place),
        matrix.new_tensor([1.0]),
        matrix[:, [2, 0]],
        matrix.cpu().to(place, torch.float16),
    ):
        assert isinstance(made, OtherTensor)
        assert made.device == place


def test_a_view_shares_its_numbers(matrix):
    matrix[0, 1:] = 7
    matrix.t()[0].add_(1)
    assert matrix.tolist() == [[1, 7, 7], [4, 4, 5]]


def test_gradients_are_the_cpus(matrix):
    here = nn.Sequential(nn.Linear(3, 4), nn.ReLU(), nn.Linear(4, 1))
    there = copy.deepcopy(here).to(matrix.device)
    for model, x in ((here, matrix.cpu()), (there, matrix)):
        model(x).square().sum().backward()
        torch.optim.AdamW(model.parameters(), foreach=True).step()
    for a, b in zip(here.parameters(), there.parameters(), strict=True):
        assert isinstance(b.grad, OtherTensor)
        assert torch.equal(a.grad, b.grad.cpu())
        assert torch.equal(a, b.cpu())


def test_autocast(matrix, place):
    layer = nn.Linear(3, 2).to(place)
    for dtype in (torch.float16, torch.bfloat16):
        with torch.autocast(place.type, dtype=dtype):
            rows = layer(matrix)
            assert rows.dtype == dtype
            assert functional.cross_entropy(rows, matrix[:, 1].long() % 2).dtype == torch.float32
            assert (rows + rows).dtype == dtype
            assert layer(matrix.double().float()).dtype == dtype
    assert layer(matrix).dtype == torch.float32


def test_memory_is_counted_and_ends(place, monkeypatch):
    before = MEMORY.taken
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

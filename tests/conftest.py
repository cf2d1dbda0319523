"""Fixtures of all tests."""

import gc
import os
import sys
from glob import glob
from importlib.metadata import version

import hypothesis
import pytest

# Machines differ in speed, and the first call compiles: no test hangs on the clock.
hypothesis.settings.register_profile("ours", deadline=None)
hypothesis.settings.load_profile("ours")

# Without a GPU, or with a torch for CPUs, kernels of a GPU run on the CPU.
if not glob("/dev/nvidia[0-9]*") or version("torch").endswith("+cpu"):
    os.environ.setdefault("TRITON_INTERPRET", "1")

if "PYTEST_XDIST_WORKER" in os.environ:
    # Tests run beside each other: more threads than cores wait for each other.
    os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Imports leave little garbage; to look for it took a fifth of their time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.fixture(autouse=True, scope="module")
def what_was_imported_is_no_garbage():
    """Collect before a module: it takes a second, and some libraries do so at every call."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def one_thread():
    """Torch adds up in the same order on every machine."""
    import torch  # slow, and most tests do without

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True)
def on_cpu(monkeypatch):
    """Networks train and detect on the CPU, also where there is a GPU; test_gpu overrides this."""
    # A module whose tests need torch has imported it.
    if "torch" in sys.modules:
        monkeypatch.setattr("torch.cuda.is_available", lambda: False)


@pytest.fixture
def large_blocks(monkeypatch):
    """Let few programs of a GPU's kernels do the work: on a CPU, the interpreter takes as long for
    an operation on few numbers as on many."""
    for name, size in {
        "neighbours._ROWS": 128, "neighbours._TILE": 1024, "neighbours._PLACES": 512,
        "neighbours._POINTS": 1024, "points_in_boxes._POINTS": 1024, "points_in_boxes._ROIS": 32,
    }.items():  # fmt: skip
        monkeypatch.setattr(f"training.ops.gpu.{name}", size)

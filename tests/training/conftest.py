"""Fixtures of the tests of detectors."""

import os

import pytest

MOVED = pytest.param(0, id="last bits moved", marks=pytest.mark.long)  # see test_last_bits


@pytest.fixture(scope="module", params=[pytest.param(None, id="as they are"), MOVED])
def last_bits(request):
    """A test runs twice: with this machine's numbers, and with those of another one.

    Seed of `LastBits`, None for this machine. It changes the test's own calls, no fixtures'.
    """
    return request.param


@pytest.fixture(autouse=True)
def kernels_on_gpu(monkeypatch):
    """Where there is a GPU, Triton's kernels run on it, also with CPU tensors."""
    if os.environ.get("TRITON_INTERPRET") != "1":
        from triton.runtime.jit import JITFunction

        from tests.training.kernels_on_gpu import on_copies

        monkeypatch.setattr(JITFunction, "run", on_copies(JITFunction.run, "cuda"))


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    """Around the call alone: a fixture would change the tests between its first and last user."""
    seed = pyfuncitem.funcargs.get("last_bits")
    if seed is None:
        return (yield)
    from tests.training.last_bits import LastBits  # imports torch

    with LastBits(seed):
        return (yield)

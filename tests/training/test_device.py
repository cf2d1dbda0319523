"""Why networks run on the CPU, on machines whose GPU cannot be used."""

import logging
from importlib import import_module

import pytest
import torch

from training import nvidia
from training.nvidia import is_out_of_memory

device = import_module("training.device")

NO_DRIVER = (
    "Found no NVIDIA driver on your system. Please check that you have an NVIDIA GPU and installed "
    "a driver from http://www.nvidia.com/Download/index.aspx"
)
OLD_DRIVER = (
    "The NVIDIA driver on your system is too old (found version 11040). Please update your GPU "
    "driver by downloading and installing a new version from the URL: http://www.nvidia.com. "
)
DRIVER_MISMATCH = (
    "Unexpected error from cudaGetDeviceCount(). Did you run some cuda functions before calling "
    "NumCudaDevices() that might have already set an error? Error 803: system has unsupported "
    "display driver / cuda driver combination"
)
NO_IMAGE = (
    "CUDA error: no kernel image is available for execution on the device\nCUDA kernel errors"
)
OLD_TOOLCHAIN = "CUDA error: the provided PTX was compiled with an unsupported toolchain.\nCUDA"
NO_COMPILER = "Failed to find C compiler. Please specify via CC environment variable"


class OutOfResources(Exception):
    """Of the same name as triton's."""


def fail(error):
    def function(*_):
        raise error

    return function


@pytest.fixture
def card(monkeypatch):
    """A machine with a card that can be used, until a test breaks something."""
    device.gpu_problem.cache_clear()
    device._warn.cache_clear()
    monkeypatch.setattr(device, "has_card", lambda: True)
    monkeypatch.setattr(device, "driver_version", lambda: "550.54.15")
    monkeypatch.setattr(device, "_run_kernels", lambda: None)
    monkeypatch.setattr("torch.version.cuda", "13.0")
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    for name, value in {
        "init": None,
        "is_available": True,
        "mem_get_info": (79e9, 80e9),
        "memory_reserved": 0,
        "get_device_capability": (6, 1),
        "get_arch_list": ["sm_75", "sm_90"],
    }.items():
        monkeypatch.setattr(f"torch.cuda.{name}", lambda *_, value=value: value)
    yield monkeypatch
    device.gpu_problem.cache_clear()
    device._warn.cache_clear()


def test_a_card_that_works(card, caplog):
    assert device.device() == torch.device("cuda")
    assert not caplog.messages


@pytest.mark.parametrize(
    ("function", "error", "line"),
    [
        ("torch.cuda.init", RuntimeError(NO_DRIVER),
         "no driver; expected one for CUDA 13.0, found 550.54.15; install it, or start Docker "
         "with --gpus all"),
        ("torch.cuda.init", RuntimeError(OLD_DRIVER),
         "driver too old; expected one for CUDA 13.0, found 550.54.15; update it, or `make clean "
         "&& make setup TORCH_BACKEND=auto`"),
        ("torch.cuda.init", RuntimeError(DRIVER_MISMATCH),
         "RuntimeError: Unexpected error from cudaGetDeviceCount(): Error 803: system has "
         "unsupported display driver / cuda driver combination; see nvidia-smi"),
        ("torch.cuda.init", RuntimeError("No CUDA GPUs are available"),
         "RuntimeError: No CUDA GPUs are available; see nvidia-smi"),
        ("torch.cuda.mem_get_info", torch.OutOfMemoryError("CUDA error: out of memory"),
         "too little free memory; end other processes, which nvidia-smi lists"),
        ("training.device._run_kernels", RuntimeError(NO_IMAGE),
         "torch lacks kernels for this card; expected one of sm_75, sm_90, found sm_61; `make "
         "clean && make setup TORCH_BACKEND=auto`"),
        ("training.device._run_kernels", RuntimeError(OLD_TOOLCHAIN),
         "driver too old; expected one for CUDA 13.0, found 550.54.15; update it, or `make clean "
         "&& make setup TORCH_BACKEND=auto`"),
        ("training.device._run_kernels", ModuleNotFoundError("No module named 'triton'"),
         "triton is missing; pip install triton"),
        ("training.device._run_kernels", RuntimeError(NO_COMPILER),
         "triton finds no C compiler; install gcc"),
        ("training.device._run_kernels", OSError("libcudnn.so.9: cannot open shared object file"),
         "OSError: libcudnn.so.9: cannot open shared object file; see nvidia-smi"),
    ],
)  # fmt: skip
def test_a_card_that_cannot_be_used_is_one_line(card, caplog, function, error, line):
    card.setattr(function, fail(error))
    for _ in range(2):
        assert device.device() == torch.device("cpu")
    assert caplog.messages == [f"GPU: {line}; networks run on the CPU"]
    assert caplog.records[0].levelno == logging.WARNING


def test_a_card_that_other_processes_fill(card, caplog):
    card.setattr("torch.cuda.mem_get_info", lambda: (0.3e9, 80e9))
    card.setattr("torch.cuda.memory_reserved", lambda: int(2e9))
    assert device.device() == torch.device("cuda"), "what this process reserved is free for it"
    card.setattr("torch.cuda.memory_reserved", lambda: 0)
    device.gpu_problem.cache_clear()
    assert device.device() == torch.device("cpu")
    expected = "GPU: too little free memory; expected 1.1 GB, found 0.3 of 80 GB; end other"
    assert caplog.messages[0].startswith(expected)


@pytest.mark.parametrize("cause", ["no card", "torch for the CPU", "hidden"])
def test_a_machine_without_a_gpu_is_no_problem(card, caplog, cause):
    card.setattr("torch.cuda.is_available", lambda: False)
    card.setattr("torch.cuda.init", fail(RuntimeError("No CUDA GPUs are available")))
    if cause == "no card":
        card.setattr(device, "has_card", lambda: False)
    elif cause == "torch for the CPU":
        card.setattr("torch.version.cuda", None)
    else:
        card.setenv("CUDA_VISIBLE_DEVICES", "")
    assert device.device() == torch.device("cpu")
    assert not caplog.messages


def test_nvml_counts_cards_that_cannot_be_used(card):
    card.setattr("torch.cuda.device_count", lambda: 1)
    assert device.gpu_count() == 1
    device.gpu_problem.cache_clear()
    card.setattr("torch.cuda.init", fail(RuntimeError(OLD_DRIVER)))
    assert device.gpu_count() == 0


def test_cards_and_drivers_by_files(tmp_path, monkeypatch):
    names = {"_PCI": tmp_path, "_DRIVER": tmp_path / "version", "_WSL": tmp_path / "dxg"}
    for name, path in names.items():
        monkeypatch.setattr(nvidia, name, path)
    (tmp_path / "0000:00:01.0").mkdir()
    (tmp_path / "0000:00:01.0" / "vendor").write_text("0x8086\n")
    assert not nvidia.has_card()
    assert nvidia.driver_version() == ""
    (tmp_path / "0000:00:02.0").mkdir()
    (tmp_path / "0000:00:02.0" / "vendor").write_text("0x10de\n")
    assert nvidia.has_card()
    (tmp_path / "version").write_text("580.65.06\n")
    assert nvidia.driver_version() == "580.65.06"


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2 GiB"), True),
        (RuntimeError("CUDA error: out of memory\nCUDA kernel errors might be"), True),
        (RuntimeError("Triton Error [CUDA]: out of memory"), True),
        (RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `cublasCreate`"), True),
        (RuntimeError("CUDA error: an illegal memory access was encountered"), False),
        (OutOfResources("out of resource: shared memory, Required: 300000"), False),
        (MemoryError("Unable to allocate 3 TiB"), False),
    ],
)
def test_what_is_out_of_gpu_memory(error, expected):
    assert is_out_of_memory(error) == expected

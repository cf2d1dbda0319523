"""NVIDIA's cards, driver and errors, without torch."""

import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

_PCI = Path("/sys/bus/pci/devices")
_DRIVER = Path("/sys/module/nvidia/version")
_WSL = Path("/dev/dxg")  # GPUs of Windows

_NVIDIA = "0x10de"
_PROBE = "from training.device import device, gpu_problem; print(gpu_problem() or device().type)"


def has_card() -> bool:
    """Test if a card is plugged in, with or without a driver."""
    vendors = (path.read_text(encoding="ascii").strip() for path in _PCI.glob("*/vendor"))
    return _DRIVER.exists() or _WSL.exists() or _NVIDIA in vendors


@cache
def device_of_networks() -> str:
    """Return "cuda" if networks can use a GPU, "cpu" without one, else the problem in a line.

    CUDA would take GPU memory for the rest of this process, so another one tries it, once."""
    if not has_card():
        return "cpu"
    folders = (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, folders))}
    command = [sys.executable, "-c", _PROBE]
    process = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    output = process.stderr if process.returncode else process.stdout
    return (output.strip().splitlines() or ["GPU: the probe ended without output"])[-1]


def driver_version() -> str:
    """Return the version of the driver that is loaded, such as "580.65.06"; empty without one."""
    return _DRIVER.read_text(encoding="ascii").strip() if _DRIVER.exists() else ""


def is_out_of_memory(error: BaseException) -> bool:
    """Test if an error of torch, triton or one of CUDA's libraries is for want of GPU memory.

    Not triton's OutOfResources: a kernel needs as much shared memory for one frame as for many."""
    pattern = r"CUDA error: out of memory|\[CUDA\]: out of memory|STATUS_ALLOC_FAILED"
    pattern += "|CUBLAS_STATUS_NOT_INITIALIZED|unable to find an engine"  # without room for one
    return type(error).__name__ == "OutOfMemoryError" or re.search(pattern, str(error)) is not None

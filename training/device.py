"""Device and floats with which networks run."""

import functools
import logging
import os
import warnings
from collections.abc import Callable

import torch

from lidarplace.base.errors import InputError
from training.nvidia import driver_version, has_card

NO_BFLOAT16 = (
    "mixed_precision: this processor has neither AVX512-BF16 nor AMX; its networks run in 32-bit "
    "floats"
)


# MKL's vector functions.
_FUNCTIONS = (
    *("acos", "asin", "atan", "cos", "sin", "tan", "tanh"),
    *("erf", "erfc", "exp", "expm1", "log", "log10", "log1p", "log2", "sqrt"),
)


@functools.cache
def settle_vector_math() -> None:
    """Let MKL choose its kernels before several threads can ask for them at once.

    MKL 2024, which torch's wheels hold, chooses the kernel of a function when it is first called.
    If several threads make that call together, one of them can compute its share by a kernel of
    low accuracy (errors to some 4,000 units in the last place): boxes of a process's first
    prediction then were 0.1 mm off those of its second. See PyTorch's issue 188792."""
    for dtype in (torch.float32, torch.float64):
        one = torch.ones(1, dtype=dtype)
        for name in _FUNCTIONS:
            getattr(torch, name)(one)


def device() -> torch.device:
    """Return the first GPU if networks can use it, else the CPU.

    A GPU that they cannot use is logged, once in a process."""
    if problem := gpu_problem():
        _warn(f"{problem}; networks run on the CPU")
    usable = has_card() and not problem and torch.cuda.is_available()
    return torch.device("cuda" if usable else "cpu")


def gpu_count() -> int:
    """Count the GPUs that networks can use; torch alone also counts those without a fit driver."""
    return torch.cuda.device_count() if device().type == "cuda" else 0


@functools.cache
def _warn(text: str) -> None:
    logging.getLogger(__name__).warning(text)


@functools.cache
def gpu_problem() -> str:
    """Describe in a line why networks cannot use the first GPU; empty if they can, or without one.

    Runs a convolution and a Triton kernel there. A card that CUDA_VISIBLE_DEVICES hides and a torch
    without CUDA are no problems."""
    if torch.version.cuda is None or not has_card():
        return ""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch's say the same in several lines
        try:
            torch.cuda.init()
            _check_free_memory()
            _run_kernels()
        except InputError as error:
            return str(error)
        except Exception as error:  # each library has its own
            hidden = "No CUDA GPUs" in str(error) and "CUDA_VISIBLE_DEVICES" in os.environ
            return "" if hidden else _explained(error)
    return ""


_FREE_BYTES = 1 << 30
"""For CUDA's context, its libraries and a frame of the smallest networks."""


def _check_free_memory() -> None:
    free, total = torch.cuda.mem_get_info()
    free += torch.cuda.memory_reserved()  # by this process
    if free < _FREE_BYTES:
        amount = f"{free / 1e9:.1f} of {total / 1e9:.0f} GB"
        expected = f"{_FREE_BYTES / 1e9:.1f} GB"
        raise InputError(_FULL, place="GPU", expected=expected, found=amount, fix=_END_OTHERS)


def _run_kernels() -> None:
    from training.ops.sampling import furthest_point_sample

    image = torch.ones(1, 1, 3, 3, device="cuda")
    torch.nn.functional.conv2d(image, image).item()
    furthest_point_sample(image.view(3, 3), [3], 2)[0].tolist()


def _explained(error: Exception) -> str:
    """Put an error of torch, CUDA or triton into a line."""
    text = " ".join(str(error).split())
    for part, problem, versions, fix in _CAUSES:
        if part in text:
            needed, present = versions()
            return str(InputError(problem, place="GPU", expected=needed, found=present, fix=fix))
    problem = f"{type(error).__name__}: {text.replace(_UNHELPFUL, ':')[:200]}"
    return str(InputError(problem, place="GPU", fix="see nvidia-smi"))


def _drivers() -> tuple[str, str]:
    return f"one for CUDA {torch.version.cuda}", driver_version() or "none"


def _capabilities() -> tuple[str, str]:
    major, minor = torch.cuda.get_device_capability()
    return f"one of {', '.join(torch.cuda.get_arch_list())}", f"sm_{major}{minor}"


def _nothing() -> tuple[str, str]:
    return "", ""


_UNHELPFUL = (
    ". Did you run some cuda functions before calling NumCudaDevices() that might have already set "
    "an error?"
)
_FULL = "too little free memory"
_END_OTHERS = "end other processes, which nvidia-smi lists"
_OTHER_TORCH = "`make clean && make setup TORCH_BACKEND=auto`"
# Part of an error's text, the problem, versions that are needed and present, and what to do.
_CAUSES: tuple[tuple[str, str, Callable[[], tuple[str, str]], str], ...] = (
    ("no NVIDIA driver", "no driver", _drivers, "install it, or start Docker with --gpus all"),
    ("driver on your system is too old", "driver too old", _drivers,
     f"update it, or {_OTHER_TORCH}"),
    ("unsupported toolchain", "driver too old", _drivers, f"update it, or {_OTHER_TORCH}"),
    ("no kernel image", "torch lacks kernels for this card", _capabilities, _OTHER_TORCH),
    ("out of memory", _FULL, _nothing, _END_OTHERS),
    ("No module named 'triton'", "triton is missing", _nothing, "pip install triton"),
    ("C compiler", "triton finds no C compiler", _nothing, "install gcc"),
)  # fmt: skip


def cpu_has_bfloat16() -> bool:
    """Test if the processor multiplies bfloat16; others emulate it, slower than 32-bit floats."""
    return bool(torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported())


def half_type(
    place: torch.device, mixed_precision: bool | str, predicting: bool = False
) -> torch.dtype | None:
    """Choose the 16-bit floats of networks on a device; None: 32-bit floats.

    bfloat16 where the hardware has it; on an older GPU float16, on an older CPU none, which is
    logged. `mixed_precision`: of the settings."""
    everywhere = mixed_precision == "everywhere"
    if not mixed_precision or (not everywhere and (predicting or place.type == "cpu")):
        return None
    if place.type == "cpu":
        if cpu_has_bfloat16():
            return torch.bfloat16
        logging.getLogger(__name__).warning(NO_BFLOAT16)
        return None
    has = torch.get_device_module(place.type).is_bf16_supported(including_emulation=False)
    return torch.bfloat16 if has else torch.float16

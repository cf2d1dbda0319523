"""Device and floats with which networks run."""

import functools
import logging

import torch

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
    """Return the first GPU if there is one, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def cpu_has_bfloat16() -> bool:
    """Test if the processor multiplies bfloat16; others emulate it, slower than 32-bit floats."""
    return bool(torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported())


def half_type(
    place: torch.device, wanted: bool | str, predicting: bool = False
) -> torch.dtype | None:
    """Choose the 16-bit floats of networks on a device; None: 32-bit floats.

    bfloat16 where the hardware has it; on an older GPU float16, on an older CPU none, which is
    logged. `wanted`: `mixed_precision` of the settings."""
    if not wanted or (wanted != "everywhere" and (predicting or place.type == "cpu")):
        return None
    if place.type == "cpu":
        if cpu_has_bfloat16():
            return torch.bfloat16
        logging.getLogger(__name__).warning(NO_BFLOAT16)
        return None
    has = torch.get_device_module(place.type).is_bf16_supported(including_emulation=False)
    return torch.bfloat16 if has else torch.float16

"""Where networks run, and with which floats."""

import logging

import torch

NO_BFLOAT16 = (
    "mixed_precision: this processor has neither AVX512-BF16 nor AMX; its networks run in 32-bit "
    "floats"
)


def device() -> torch.device:
    """The first GPU if there is one, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def cpu_has_bfloat16() -> bool:
    """Whether the processor multiplies bfloat16; others emulate it, slower than 32-bit floats."""
    return bool(torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported())


def half_type(
    place: torch.device, wanted: bool | str, predicting: bool = False
) -> torch.dtype | None:
    """The 16-bit floats of networks on a device; None: 32-bit floats.

    bfloat16 where the hardware has it; on an older GPU float16, on an older CPU none, which is
    logged.

    Args:
        place: the device.
        wanted: `mixed_precision` of the settings.
        predicting: not for a training.
    """
    if not wanted or (wanted != "everywhere" and (predicting or place.type == "cpu")):
        return None
    if place.type == "cpu":
        if cpu_has_bfloat16():
            return torch.bfloat16
        logging.getLogger(__name__).warning(NO_BFLOAT16)
        return None
    has = torch.get_device_module(place.type).is_bf16_supported(including_emulation=False)
    return torch.bfloat16 if has else torch.float16

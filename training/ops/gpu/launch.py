"""Launch of Triton kernels."""

from typing import Any


def launch(kernel: Any, programs: int, *arguments: Any, warps: int = 4, **constants: float) -> None:
    """Run `programs` programs of a Triton kernel on the device of its tensors.

    Products and sums are rounded one by one, as on a CPU: points on a border fall on the same side.
    """
    if programs:
        options = {"num_warps": warps, "enable_fp_fusion": False}
        kernel[(programs,)](*arguments, **constants, **options)

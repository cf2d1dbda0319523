"""Cosine and sine of yaws, the same on every machine."""

import torch
from torch import Tensor


def cos_sin(yaw: Tensor) -> tuple[Tensor, Tensor]:
    """Cosine and sine of angles, radians, in their shape and dtype. Gradients flow.

    Libraries of mathematical functions differ in the last bit, and so would points on the border of
    a box. Rounded from double precision, float32 values differ in one of 10⁸ cases.
    """
    wide = yaw.double()
    return torch.cos(wide).to(yaw.dtype), torch.sin(wide).to(yaw.dtype)

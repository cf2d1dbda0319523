"""The first call of MKL's vector functions, made by one thread."""

import functools

import torch

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
    prediction then were 0.1 mm off those of its second. See PyTorch's issue 188792.
    """
    for dtype in (torch.float32, torch.float64):
        one = torch.ones(1, dtype=dtype)
        for name in _FUNCTIONS:
            getattr(torch, name)(one)

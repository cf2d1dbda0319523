"""Another machine's last bits: what libraries compute to the last digit but one.

IEEE 754 fixes +, -, ×, ÷, but neither a library's exp, sin or square root (MKL's on an AMD EPYC is
one unit in the last place off for 17 % of float32 numbers) nor the order in which a matrix product
adds up.
"""

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

FUNCTIONS = frozenset(
    [
        *("sqrt", "rsqrt", "hypot", "linalg_vector_norm", "norm", "_cdist_forward"),
        *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "erf", "erfc"),
        *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
        *("sigmoid", "log_sigmoid_forward", "logit", "softplus", "_softmax", "_log_softmax"),
        *("binary_cross_entropy_with_logits", "native_batch_norm"),
        *("mm", "addmm", "bmm", "linear", "convolution"),
    ]
)
_BITS = {torch.float64: torch.int64, torch.float32: torch.int32}


class LastBits(TorchDispatchMode):
    """Block in which FUNCTIONS of torch give the next number above or below, or their own.

    As on a machine, the same value always gives the same; which of the three, a hash of it and of
    `seed` decides. 0, 1, -1 and what is not finite stay: they are bounds of these functions, or
    right everywhere. numpy and numba stay too.
    """

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._seed = seed

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        result = func(*args, **(kwargs or {}))
        name = func.overloadpacket.__name__
        power = args[1] if name in ("pow", "pow_") else 1
        root = isinstance(power, Tensor) or not float(power).is_integer()
        if not (root or name.removesuffix("_") in FUNCTIONS):
            return result
        first = result[0] if isinstance(result, tuple) else result
        other = self._neighbours(first)
        if name.endswith("_"):
            return first.copy_(other)
        return (other, *result[1:]) if isinstance(result, tuple) else other

    def _neighbours(self, values: Tensor) -> Tensor:
        if values.dtype not in _BITS:
            return values
        bits = values.view(_BITS[values.dtype])
        # Multiplicative hashing (Knuth, The art of computer programming 3), with few temporaries.
        hashed = (bits + self._seed).mul_(-1640531535)
        step = (hashed >> 20).bitwise_and_(1)
        step.sub_(hashed.bitwise_right_shift_(21).bitwise_and_(1))
        step.masked_fill_((values == 0) | (values.abs() == 1) | ~values.isfinite(), 0)
        return step.add_(bits).view(values.dtype)

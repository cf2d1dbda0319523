"""A device that stands for a GPU where there is none: its tensors say that they lie elsewhere, and
compute on the CPU.

As with a GPU, an operation on tensors of two devices is an error, so is `numpy()`, branches on the
device take the GPU's side, autocast has CUDA's rules for the operations of the networks, and memory
ends. Unlike a GPU it has the CPU's kernels: it rounds and orders as they do and waits for every
result. Row numbers on the CPU, which a GPU would copy for itself, are an error here.
"""

import sys
import weakref
from collections import Counter
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
import torch
import triton.language as tl
from torch import Tensor
from torch.utils._python_dispatch import return_and_correct_aliasing
from torch.utils._pytree import tree_map_only
from torch.utils.backend_registration import (
    _DummyBackendModule,
    _setup_privateuseone_for_python_backend,
)
from triton.runtime import interpreter

import training
from training.ops.gpu import grouping, sparse_conv, sparse_rules

NAME = "other"
_ROOT = Path(training.__file__).parent
_aten = torch.ops.aten
_MOVES = (_aten._to_copy.default, _aten.copy_.default)
"""Operations that may have tensors of two devices."""


WAITS: list[Path] = []
"""Files of `training` that have waited for a GPU so far, each as often as it would."""

_OF_UNKNOWN_SIZE = frozenset(
    [
        *("_local_scalar_dense", "equal", "nonzero", "masked_select", "bincount"),
        *("_unique2", "unique_dim", "unique_consecutive"),
    ]
)


def _add_wait() -> None:
    frame = sys._getframe(1)
    while frame and _ROOT not in Path(frame.f_code.co_filename).parents:
        frame = frame.f_back
    if frame:  # else a test waits
        WAITS.append(Path(frame.f_code.co_filename))


def _waits(operation, args, kwargs, moves: bool) -> bool:
    name = operation.overloadpacket.__name__
    if name.removesuffix("_") in ("index", "index_put"):
        return any(item is not None and item.dtype == torch.bool for item in args[1])
    if name == "repeat_interleave":
        return kwargs.get("output_size") is None
    if operation in _MOVES:
        return moves and not (kwargs.get("non_blocking") or True in args[2:])
    return name in _OF_UNKNOWN_SIZE


class Memory(_DummyBackendModule):
    """Counterpart of torch.cuda; counts the bytes of the tensors that are alive."""

    total = 1 << 40  # bytes that there are
    share = 1.0  # of it for this process
    bfloat16 = True  # whether there is hardware for it

    def __init__(self) -> None:
        self.taken = self.peak = 0
        self._users: Counter[int] = Counter()
        self._sizes: dict[int, int] = {}

    def take(self, tensor: Tensor, held: Tensor) -> None:
        """Count the memory of `held` for as long as `tensor` lives; views share theirs."""
        storage = held.untyped_storage()
        place, size = storage.data_ptr(), storage.nbytes()
        if size == 0:
            return
        if not self._users[place]:
            if self.taken + size > self.total:
                raise torch.OutOfMemoryError(f"{NAME} out of memory. Tried to allocate {size} B")
            self._sizes[place] = size
            self.taken += size
            self.peak = max(self.peak, self.taken)
        self._users[place] += 1
        weakref.finalize(tensor, self._leave, place).atexit = False

    def _leave(self, place: int) -> None:
        self._users[place] -= 1
        if not self._users[place]:
            self.taken -= self._sizes.pop(place)

    def empty_cache(self) -> None:
        """Do nothing: there is no cache."""

    def reset_peak_memory_stats(self, device=None) -> None:
        self.peak = self.taken

    def memory_reserved(self, device=None) -> int:
        return self.taken

    def max_memory_reserved(self, device=None) -> int:
        return self.peak

    def mem_get_info(self, device=None) -> tuple[int, int]:
        return self.total - self.taken, self.total

    def get_per_process_memory_fraction(self, device=None) -> float:
        return self.share

    def is_bf16_supported(self, including_emulation: bool = True) -> bool:
        return self.bfloat16

    def get_amp_supported_dtype(self) -> list[torch.dtype]:
        return [torch.float16, torch.bfloat16]


MEMORY = Memory()


class OtherTensor(Tensor):
    """A tensor on the other device; `held` is the CPU tensor that has its numbers."""

    held: Tensor
    __torch_function__ = torch._C._disabled_torch_function_impl

    @staticmethod
    def __new__(cls, held: Tensor) -> "OtherTensor":
        layout = {"strides": held.stride(), "storage_offset": held.storage_offset()}
        kind = {"dtype": held.dtype, "device": torch.device(NAME, 0)}
        self = Tensor._make_wrapper_subclass(cls, held.shape, **layout, **kind)
        self.held = held
        MEMORY.take(self, held)
        return self

    @classmethod
    def __torch_dispatch__(cls, operation, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        options = {name: _held(operation, value) for name, value in kwargs.items()}
        leaves = False
        if options.get("device"):
            leaves = torch.device(options["device"]).type != NAME
            options["device"] = torch.device("cpu")
        moves = leaves or any(isinstance(item, Tensor) and item.is_cpu for item in args)
        if _waits(operation, args, kwargs, moves):
            _add_wait()
        out = operation(*_held(operation, args), **options)
        return return_and_correct_aliasing(operation, args, kwargs, out if leaves else _other(out))

    def tolist(self):
        _add_wait()
        return self.held.tolist()

    def __reduce_ex__(self, protocol):
        """A file has the CPU's tensor: `torch.load` need not know this class."""
        return self.held.__reduce_ex__(protocol)

    def __format__(self, spec: str) -> str:
        return format(self.item() if self.dim() == 0 else repr(self), spec)

    def __repr__(self, *, tensor_contents=None) -> str:
        return f"{NAME}: {self.held}"


# The mappings of torch.utils._pytree would take most of the time.


def _held(operation, value):
    """CPU tensors in place of the device's, in lists and tuples too."""
    if isinstance(value, OtherTensor):
        same = value.shape == value.held.shape and value.dtype == value.held.dtype
        assert same, f"an operation before {operation} changed a tensor as {NAME} cannot follow"
        return value.held
    if isinstance(value, list | tuple):
        return [_held(operation, item) for item in value]
    # A single number may come from anywhere, as with a GPU.
    if isinstance(value, Tensor) and value.dim() and operation not in _MOVES:
        raise RuntimeError(
            f"{operation} needs all tensors on {NAME}, found one on {value.device}: "
            f"shape {tuple(value.shape)}, {value.dtype}"
        )
    return value


def _other(value):
    """The device's tensors in place of the CPU's."""
    if isinstance(value, list | tuple):
        return type(value)(map(_other, value))
    return OtherTensor(value) if isinstance(value, Tensor) else value


# What torch does without a tensor of the device, and so not through __torch_dispatch__.


def _made(operation):
    def kernel(*args, layout=None, device=None, pin_memory=None, **options):
        return OtherTensor(operation(*args, **options))

    return kernel


def _copy_from(source: Tensor, target: Tensor, non_blocking: bool = False) -> Tensor:
    """`copy_` where torch looks past __torch_dispatch__, as torch.tensor does."""
    if not non_blocking:
        _add_wait()
    held, numbers = (getattr(item, "held", item) for item in (target, source))
    held.copy_(numbers)
    return target


_KERNELS = {
    "empty.memory_format": _made(_aten.empty.memory_format),
    "empty_strided": _made(_aten.empty_strided.default),
    "arange": _made(_aten.arange.default),
    "arange.start": _made(_aten.arange.start),
    "arange.start_step": _made(_aten.arange.start_step),
    "_copy_from": _copy_from,
}

# CUDA's rules of autocast, https://docs.pytorch.org/docs/stable/amp.html.
_IN_16_BITS = (
    *("addmm", "bmm", "conv1d", "conv2d", "conv_transpose2d.input", "linear", "matmul", "mm"),
)
_IN_32_BITS = (
    *("binary_cross_entropy_with_logits", "cross_entropy_loss", "exp", "log", "log_softmax.int"),
    *("nll_loss", "norm.Scalar", "pow.Tensor_Scalar", "smooth_l1_loss", "softmax.int", "sum"),
    "sum.dim_IntList",
)


def _autocast(name: str, dtype: torch.dtype | None):
    packet, overload = (name + ".default").split(".")[:2]
    operation = getattr(getattr(_aten, packet), overload)

    def in_precision(item: Tensor) -> Tensor:
        eligible = item.is_floating_point() and item.dtype != torch.float64
        return item.to(dtype or torch.get_autocast_dtype(NAME)) if eligible else item

    def kernel(*args, **kwargs):
        args, kwargs = tree_map_only(OtherTensor, in_precision, (args, kwargs))
        with torch.autocast(NAME, enabled=False):
            return operation(*args, **kwargs)

    return kernel


@cache
def _registered() -> list[torch.library.Library]:
    """Make the device known to torch, for the rest of the process."""
    _setup_privateuseone_for_python_backend(NAME, MEMORY)
    aten, every = torch.library.Library("aten", "IMPL"), torch.library.Library("_", "IMPL")
    for name, kernel in _KERNELS.items():
        aten.impl(name, kernel, "PrivateUse1")
    every.fallback(torch.library.fallthrough_kernel, "AutocastPrivateUse1")
    for names, dtype in ((_IN_16_BITS, None), (_IN_32_BITS, torch.float32)):
        for name in names:
            aten.impl(name, _autocast(name, dtype), "AutocastPrivateUse1")
    return [aten, every]  # what is registered goes with them


_BLOCKS = (
    *((sparse_conv, "_ROWS", 4096), (sparse_conv, "_OUTPUTS", 64)),
    *((sparse_conv, "_PORTION", 1 << 20), (sparse_rules, "_LANES", 8192)),
    (grouping, "_LANES", 4096),
)
"""Blocks of kernels as large as the interpreter likes them."""


_OPTIONS = interpreter.InterpreterOptions(sanitize_overflow=False)


def _dot(self, a, b, total, input_precision, *options):
    """The interpreter's product, which takes the bits of bfloat16 for integers."""
    a, b = (
        self.create_fp_ext(item, tl.float32) if item.dtype == tl.bfloat16 else item
        for item in (a, b)
    )
    product = np.matmul(a.data, b.data, dtype=total.data.dtype)
    return interpreter.TensorHandle(product + total.data, total.dtype.scalar)


@contextmanager
def other_device():
    """The device, while no thread but the caller's computes.

    Autograd has a thread for every device that torch knew when the process made its first step.
    """
    _registered()
    with ExitStack() as patches:
        for place, name, value in (
            (interpreter, "_unwrap_tensor", lambda tensor: getattr(tensor, "held", tensor)),
            (interpreter.InterpreterBuilder, "create_dot", _dot),
            # Without checks of every sum for overflow, which take half of the time.
            (interpreter.interpreter_builder, "options", _OPTIONS),
            *_BLOCKS,
        ):
            patches.enter_context(patch.object(place, name, value))
        patches.enter_context(torch.autograd.set_multithreading_enabled(False))
        yield torch.device(NAME, 0)

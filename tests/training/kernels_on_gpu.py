"""Kernels of tests that call them with CPU tensors, run on a GPU."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor


def on_copies(run: Callable[..., Any], device: str) -> Callable[..., Any]:
    """Make `run` of a kernel take copies of CPU tensors on `device`, which are written back.

    Whole storages are copied: views keep their strides, and tensors of one storage share a copy.
    """

    def run_on_copies(*arguments: Any, **options: Any) -> Any:
        copies: dict[int, tuple[Tensor, Tensor]] = {}

        def moved(value: Any) -> Any:
            held = getattr(value, "held", value)  # of the device that stands for a GPU
            if not isinstance(held, Tensor) or held.device.type != "cpu":
                return value
            storage = held.untyped_storage()
            if storage.data_ptr() not in copies:
                whole = torch.empty(0, dtype=torch.uint8).set_(storage)
                copies[storage.data_ptr()] = whole, whole.to(device, copy=True)
            copy = copies[storage.data_ptr()][1].untyped_storage()
            view = held.storage_offset(), held.size(), held.stride()
            return torch.empty(0, dtype=held.dtype, device=device).set_(copy, *view)

        result = run(*map(moved, arguments), **options)
        for whole, copy in copies.values():
            whole.copy_(copy)
        return result

    return run_on_copies

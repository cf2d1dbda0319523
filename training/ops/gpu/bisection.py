"""Bisection of sorted keys, which kernels share."""

import triton
import triton.language as tl


@triton.jit
def count_up_to(keys, limit, count):
    """Number of the `count` sorted integers `keys` that are at most `limit`, shape of `limit`."""
    low = tl.zeros_like(limit).to(tl.int32)
    length = tl.zeros((), tl.int32) + count
    while length > 0:
        half = (length + 1) // 2
        low = tl.where(tl.load(keys + (half - 1) + low) <= limit, low + half, low)
        length -= half
    return low

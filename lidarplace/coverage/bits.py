"""Sets of voxels as bits: bit k % 64 of word k // 64 is voxel k of a column.

A set is an array of shape (words, nx, ny), uint64."""

import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.uint64]


def empty(shape: tuple[int, int, int]) -> Bits:
    """The empty set of a grid of that shape."""
    return np.zeros((-(-shape[2] // 64), shape[0], shape[1]), np.uint64)


def pack(mask: NDArray[np.bool_]) -> Bits:
    """The voxels of a mask of shape (nx, ny, nz)."""
    nx, ny, nz = mask.shape
    octets = np.zeros((nx, ny, -(-nz // 64) * 8), np.uint8)
    octets[..., : -(-nz // 8)] = np.packbits(np.ascontiguousarray(mask), axis=-1, bitorder="little")
    words = octets.view("<u8").astype(np.uint64, copy=False)
    return np.ascontiguousarray(np.moveaxis(words, 2, 0))


def unpack(bits: Bits, nz: int) -> NDArray[np.bool_]:
    """The mask of a set, shape (nx, ny, nz)."""
    words = np.ascontiguousarray(np.moveaxis(bits, 0, 2)).astype("<u8", copy=False)
    return np.unpackbits(words.view(np.uint8), axis=-1, count=nz, bitorder="little").view(np.bool_)

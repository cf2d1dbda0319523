"""Sets of voxels as bits: bit k % 64 of word k // 64 is voxel k of a column.

A set is an array of shape (words, nx, ny), uint64."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit

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


def turned(bits: Bits, length: int) -> Bits:
    """The set with its last two axes exchanged: from voxels (a, b, c) to (a, c, b), c below
    `length`."""
    _, a, b = bits.shape
    result = np.zeros((-(-b // 64), a, length), np.uint64)
    _turn(bits, result)
    return result


@njit(cache=True, nogil=True)
def _turn(bits, result):
    """Transpose blocks of 64 × 64 bits by exchanging ever smaller halves (Warren, 7-3)."""
    block = np.empty(64, np.uint64)
    for word in range(len(result)):
        for a in range(bits.shape[1]):
            for other in range(len(bits)):
                for i in range(64):
                    b = 64 * word + i
                    block[i] = bits[other, a, b] if b < bits.shape[2] else np.uint64(0)
                width = 32
                mask = np.uint64(0x00000000FFFFFFFF)
                while width:
                    shift = np.uint64(width)
                    i = 0
                    while i < 64:
                        swap = ((block[i] >> shift) ^ block[i + width]) & mask
                        block[i] ^= swap << shift
                        block[i + width] ^= swap
                        i = (i + width + 1) & ~width
                    width >>= 1
                    mask ^= mask << np.uint64(max(width, 1))
                for i in range(64):
                    c = 64 * other + i
                    if c < result.shape[2]:
                        result[word, a, c] = block[i]

"""Sets of voxels as bits: bit k % 64 of word k // 64 is voxel k of a column.

A set is an array of shape (words, nx, ny), uint64."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit

Bits = NDArray[np.uint64]


def empty(shape: tuple[int, int, int]) -> Bits:
    """Return the empty set of a grid of that shape."""
    return np.zeros((-(-shape[2] // 64), shape[0], shape[1]), np.uint64)


def pack(mask: NDArray[np.bool_]) -> Bits:
    """Return the voxels of a mask of shape (nx, ny, nz) as a set."""
    nx, ny, nz = mask.shape
    octets = np.zeros((nx, ny, -(-nz // 64) * 8), np.uint8)
    octets[..., : -(-nz // 8)] = np.packbits(np.ascontiguousarray(mask), axis=-1, bitorder="little")
    words = octets.view("<u8").astype(np.uint64, copy=False)
    return np.ascontiguousarray(np.moveaxis(words, 2, 0))


def unpack(bits: Bits, nz: int) -> NDArray[np.bool_]:
    """Return the mask of a set, shape (nx, ny, nz)."""
    words = np.ascontiguousarray(np.moveaxis(bits, 0, 2)).astype("<u8", copy=False)
    return np.unpackbits(words.view(np.uint8), axis=-1, count=nz, bitorder="little").view(np.bool_)


def exchange_columns(bits: Bits, length: int) -> Bits:
    """Return the set of voxels (a, c, b) for a set of voxels (a, b, c), c below `length`."""
    _, a, b = bits.shape
    result = np.zeros((-(-b // 64), a, length), np.uint64)
    _transpose(bits, result)
    return result


@njit(cache=True, nogil=True)
def _transpose(bits, result):
    """Transpose blocks of 64 × 64 bits by exchanging ever smaller halves.

    Source: Warren, Hacker's Delight, 2nd edition, section 7-3."""
    block = np.empty(64, np.uint64)
    for a in range(bits.shape[1]):
        for row, column in np.ndindex(len(bits), len(result)):
            some = np.uint64(0)
            for i in range(64):
                b = 64 * column + i
                block[i] = bits[row, a, b] if b < bits.shape[2] else np.uint64(0)
                some |= block[i]
            if not some:
                continue
            width, mask = 32, np.uint64(0x00000000FFFFFFFF)
            while width:
                shift = np.uint64(width)
                for start in range(0, 64, 2 * width):
                    for i in range(start, start + width):
                        swap = ((block[i] >> shift) ^ block[i + width]) & mask
                        block[i] ^= swap << shift
                        block[i + width] ^= swap
                width >>= 1
                mask ^= mask << np.uint64(width)
            for i in range(min(64, result.shape[2] - 64 * row)):
                result[column, a, 64 * row + i] = block[i]

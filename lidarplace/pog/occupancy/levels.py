"""The occupied voxels of a grid, column by column, grouped by how often they are occupied.

A column has few different counts, as objects stand on the ground and have flat tops: with a bit a
voxel, the covered voxels of one count are counted at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inlined, njit
from lidarplace.coverage.bits import Bits
from lidarplace.coverage.tiles import Tiles


@dataclass(frozen=True, eq=False)
class Levels:
    """Sets of voxels that share a column and a count; voxels with count 0 are in none.

    The sets of column c of word w are `first[c]` to `first[c + 1]`, where columns are numbered as
    the elements of a bit set of shape (words, nx, ny). `voxels` has a bit for every voxel of the
    word that is in a set, `level` its level; `counts`, ascending, and `total` are the count of a
    level and the number of its voxels, `tiles` where there are occupied voxels."""

    first: NDArray[np.int64]
    voxels: NDArray[np.uint64]
    level: NDArray[np.int64]
    counts: NDArray[np.int32]
    total: NDArray[np.int64]
    tiles: Tiles

    @classmethod
    def of_counts(cls, counts: NDArray[np.int32]) -> Levels:
        """Group the voxels of `counts`, shape (nx, ny, nz)."""
        words = -(-counts.shape[2] // 64)
        first = np.zeros(words * counts.shape[0] * counts.shape[1] + 1, np.int64)
        nothing = np.empty(0, np.uint64), np.empty(0, np.int32)
        size = _group(counts, first, *nothing)
        voxels, count_of_set = np.empty(size, np.uint64), np.empty(size, np.int32)
        _group(counts, first, voxels, count_of_set)
        # Tables are as long as there are different counts, which may be few and large.
        values, level = np.unique(count_of_set, return_inverse=True)
        total = np.zeros(len(values), np.int64)
        np.add.at(total, level, np.bitwise_count(voxels))
        return cls(first, voxels, level, values, total, Tiles.of_voxels(counts > 0))

    def covered(self, bits: Bits) -> NDArray[np.int64]:
        """Return the number of voxels of a set by their level, shape (levels,)."""
        number = np.zeros(len(self.counts), np.int64)
        _count_covered(bits.reshape(-1), self.first, self.voxels, self.level, number)
        return number


@njit(cache=True, nogil=True)
def _group(counts, first, voxels, count_of_set):
    """Fill `first`, and the sets where there is room for them; return the number of sets."""
    nx, ny, nz = counts.shape
    of_column, members = np.empty(64, np.int32), np.empty(64, np.uint64)
    size, column = 0, 0
    for word in range((nz + 63) // 64):
        for i in range(nx):
            for j in range(ny):
                part = counts[i, j, 64 * word : min(64 * word + 64, nz)]
                number = _group_column(part, of_column, members)
                first[column] = size
                if len(voxels):
                    for n in range(number):
                        voxels[size + n], count_of_set[size + n] = members[n], of_column[n]
                size += number
                column += 1
    first[column] = size
    return size


@inlined
def _group_column(counts, of_column, members):
    """List the different counts of a column, and their voxels as bits; return their number."""
    number, last = 0, 0
    for k in range(len(counts)):
        count = counts[k]
        if count == 0:
            continue
        if number == 0 or of_column[last] != count:
            last = 0
            while last < number and of_column[last] != count:
                last += 1
            if last == number:
                of_column[last], members[last] = count, 0
                number += 1
        members[last] |= np.uint64(1) << np.uint64(k)
    return number


@njit(cache=True, nogil=True)
def _count_covered(bits, first, voxels, level, number):
    for column in range(len(bits)):
        if bits[column] == 0:
            continue
        for n in range(first[column], first[column + 1]):
            covered = bits[column] & voxels[n]
            ones = 0  # this loop compiles to one instruction that counts bits
            while covered:
                covered &= covered - np.uint64(1)
                ones += 1
            number[level[n]] += ones

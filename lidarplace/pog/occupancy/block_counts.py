"""In how many frames of each block of a log a voxel is occupied, and so of any mix of blocks.

Neighbouring voxels have the same history: the same cars passed them in the same blocks. Histories
are kept as a tree. A node is its parent's history and one further block with its count, so the
counts of all histories, whatever the weights of the blocks, take one addition a node.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit


@dataclass(frozen=True, eq=False)
class BlockCounts:
    """Histories of the voxels of one class.

    Attributes:
        voxels: flat indices, C order, of the voxels that are ever occupied, int64, shape (n,).
        history: node of each of them, int32, shape (n,).
        parent, block, count: what a node adds to its parent, int32, shape (nodes,); parents come
            before their children. Node 0 is the history of voxels that are never occupied.
    """

    voxels: NDArray[np.int64]
    history: NDArray[np.int32]
    parent: NDArray[np.int32]
    block: NDArray[np.int32]
    count: NDArray[np.int32]

    @classmethod
    def of_blocks(cls, blocks: Iterable[NDArray[np.int32]]) -> BlockCounts:
        """Histories from the counts of every block, arrays of one shape, read once in order."""
        node = np.empty(0, np.int32)
        nodes = np.zeros((4, 1), np.int32)  # parent, block, count; youngest child
        size = 1
        for number, counts in enumerate(blocks):
            flat = counts.reshape(-1)
            if not len(node):
                node = np.zeros(len(flat), np.int32)
            room = size + np.count_nonzero(flat)
            if room > nodes.shape[1]:
                larger = np.zeros((4, 2 * room), np.int32)
                larger[:, :size] = nodes[:, :size]
                nodes = larger
            size = _refine(flat, number, node, nodes[0], nodes[1], nodes[2], nodes[3], size)
        voxels = np.flatnonzero(node)
        parent, block, count = (row[:size].copy() for row in nodes[:3])
        return cls(voxels, node[voxels], parent, block, count)

    def counts(self, multiplicity: NDArray[np.integer]) -> NDArray[np.int64]:
        """Count of every node when block b is taken `multiplicity[b]` times, shape (nodes,)."""
        return _counts(self.parent, self.block, self.count, multiplicity.astype(np.int64))


@njit(cache=True, nogil=True)
def _refine(counts, number, node, parent, block, count, youngest, size):  # pragma: no cover
    """Move the voxels of `counts` to children of their nodes; returns the new number of nodes.

    The siblings of one block follow each other: `youngest` of a child is its next older sibling
    until the block ends, so few are looked at.
    """
    first = size
    older = np.zeros(len(parent) - first, np.int32)
    for v in range(len(counts)):
        c = counts[v]
        if c == 0:
            continue
        mother = node[v]
        child = youngest[mother]
        while child >= first and count[child] != c:
            child = older[child - first]
        if child < first:
            child = size
            parent[child], block[child], count[child] = mother, number, c
            older[child - first] = youngest[mother]
            youngest[mother] = child
            size += 1
        node[v] = child
    return size


@njit(cache=True, nogil=True)
def _counts(parent, block, count, multiplicity) -> NDArray[np.int64]:  # pragma: no cover - compiled
    result = np.zeros(len(parent), np.int64)
    for n in range(1, len(parent)):
        result[n] = result[parent[n]] + multiplicity[block[n]] * count[n]
    return result

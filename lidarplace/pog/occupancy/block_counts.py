"""Counts of occupied frames by block of a log, and so of any mix of blocks.

Neighbouring voxels have the same history: the same cars passed them in the same blocks. Histories
are a tree: a node is its parent's history and one further block with its count, so the counts of
all histories, whatever the weights of the blocks, take one addition a node."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit

_MOST = 2**31  # above any count of frames


@dataclass(frozen=True, eq=False)
class BlockCounts:
    """Histories of the voxels of one class.

    `voxels` are the flat indices, C order, of those that are ever occupied, `history` the node of
    each; `parent, block, count` what a node adds to its parent, shape (nodes,). Parents come before
    their children; node 0 is the history of voxels that are never occupied."""

    voxels: NDArray[np.int64]
    history: NDArray[np.int32]
    parent: NDArray[np.int32]
    block: NDArray[np.int32]
    count: NDArray[np.int32]

    @classmethod
    def of_blocks(cls, blocks: Iterable[NDArray[np.int32]]) -> BlockCounts:
        """Return histories from the counts of every block, arrays of one shape, read once."""
        nodes = [np.zeros((3, 1), np.int64)]  # parent, block, count
        node, size = np.empty(0, np.int64), 1
        for number, counts in enumerate(blocks):
            flat = counts.reshape(-1)
            if not len(node):
                node = np.zeros(len(flat), np.int64)
            met = np.flatnonzero(flat)
            pairs, child = np.unique(node[met] * _MOST + flat[met], return_inverse=True)
            parent, count = np.divmod(pairs, _MOST)
            nodes.append(np.stack([parent, np.full(len(pairs), number), count]))
            node[met] = size + child
            size += len(pairs)
        voxels = np.flatnonzero(node)
        parent, block, count = np.concatenate(nodes, axis=1).astype(np.int32)
        return cls(voxels, node[voxels].astype(np.int32), parent, block, count)

    def counts(self, multiplicity: NDArray[np.integer]) -> NDArray[np.int64]:
        """Count of every node when block b is taken `multiplicity[b]` times, shape (nodes,)."""
        return _counts(self.parent, self.block, self.count, multiplicity.astype(np.int64))


@njit(cache=True, nogil=True)
def _counts(parent, block, count, multiplicity) -> NDArray[np.int64]:
    result = np.zeros(len(parent), np.int64)
    for n in range(1, len(parent)):
        result[n] = result[parent[n]] + multiplicity[block[n]] * count[n]
    return result

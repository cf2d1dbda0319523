"""Parts of the searches: portions, order by key, the first hits of each place, their features."""

from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.base.kernel_cache import njit

CHUNK = 1 << 24  # pairs that the torch paths hold at once


def chunks(rows: int, pairs: int) -> Iterator[slice]:
    """Cut `rows`, each of which has `pairs` pairs, into portions of at most CHUNK pairs."""
    step = max(1, CHUNK // max(1, pairs))
    return (slice(low, low + step) for low in range(0, rows, step))


@njit(cache=True)
def counting_sort(
    keys: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows in order of their keys, 0 … count - 1, and where the rows of each key begin."""
    starts = np.zeros(count + 1, np.int64)
    for key in keys:
        starts[key + 1] += 1
    for key in range(count):
        starts[key + 1] += starts[key]
    order = np.empty(len(keys), np.int64)
    place = starts[:-1].copy()
    for i in range(len(keys)):
        order[place[keys[i]]] = i
        place[keys[i]] += 1
    return order, starts


def group(features: Tensor, idx: Tensor) -> Tensor:
    """Select rows `idx` (M, S) of `features` (N, C), shape (M, S, C); zeros without features.

    Gradients flow to `features`."""
    if len(features) == 0:
        return features.new_zeros(*idx.shape, features.shape[1])
    return features.index_select(0, idx.flatten()).view(*idx.shape, features.shape[1])


def first_hits(mask: Tensor, samples: int) -> tuple[Tensor, Tensor]:
    """Find the columns of the first `samples` true entries of each row of `mask` (M, N).

    Returns (M, samples) int64, of which row i has `counts[i]` columns in rising order, then 0, and
    counts (M,) int64, at most `samples`."""
    # No nonzero(): a GPU's host would have to wait for the number of hits.
    wanted = torch.arange(1, samples + 1, dtype=torch.int32, device=mask.device)
    wanted = wanted.repeat(len(mask), 1)
    idx = torch.searchsorted(mask.cumsum(dim=1, dtype=torch.int32), wanted)
    counts = mask.sum(dim=1).clamp_max(samples)
    return torch.where(wanted <= counts[:, None], idx, 0), counts


def padded_with_first(idx: Tensor, counts: Tensor) -> Tensor:
    """Repeat the first column of `idx` (M, S) of `first_hits` behind the `counts` (M,) hits."""
    hit = torch.arange(idx.shape[1], device=idx.device) < counts[:, None]
    return torch.where(hit, idx, idx[:, :1])

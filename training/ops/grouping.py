"""Parts of the searches: numbers of rows, order by key, features of the chosen rows."""

from collections.abc import Iterable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.base.kernel_cache import njit


def stacked_counts(counts: Iterable[int], device: torch.device) -> Tensor:
    """Copy the numbers of rows of stacked frames to a device, (B,) int64, without waiting."""
    return torch.tensor([*counts], dtype=torch.int64).to(device, non_blocking=True)


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

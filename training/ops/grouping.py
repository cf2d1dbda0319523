"""What the searches share: portions, the first hits of each place, and their features."""

from collections.abc import Iterator

import torch
from torch import Tensor

CHUNK = 1 << 24  # pairs that the torch paths hold at once


def chunks(rows: int, pairs: int) -> Iterator[slice]:
    """Portions of so many rows, each of which has so many pairs."""
    step = max(1, CHUNK // max(1, pairs))
    return (slice(low, low + step) for low in range(0, rows, step))


def group(features: Tensor, idx: Tensor) -> Tensor:
    """Rows `idx` (M, S) of `features` (N, C), shape (M, S, C); zeros if there are no features.

    Gradients flow to `features`.
    """
    if len(features) == 0:
        return features.new_zeros(*idx.shape, features.shape[1])
    return features.index_select(0, idx.flatten()).view(*idx.shape, features.shape[1])


def first_hits(mask: Tensor, samples: int) -> tuple[Tensor, Tensor]:
    """Columns of the first `samples` true entries of each row of `mask` (M, N), and their number.

    Returns (M, samples) int64, of which row i has `counts[i]` columns in rising order, then 0, and
    counts (M,) int64, at most `samples`.
    """
    # No nonzero(): a GPU's host would have to wait for the number of hits.
    wanted = torch.arange(1, samples + 1, dtype=torch.int32, device=mask.device)
    wanted = wanted.repeat(len(mask), 1)
    idx = torch.searchsorted(mask.cumsum(dim=1, dtype=torch.int32), wanted)
    counts = mask.sum(dim=1).clamp_max(samples)
    return torch.where(wanted <= counts[:, None], idx, 0), counts


def padded_with_first(idx: Tensor, counts: Tensor) -> Tensor:
    """`idx` (M, S) of `first_hits` with its first column repeated behind the `counts` (M,) hits."""
    hit = torch.arange(idx.shape[1], device=idx.device) < counts[:, None]
    return torch.where(hit, idx, idx[:, :1])

"""The first few true positions of every row of a mask, the common end of the neighbour searches."""

from __future__ import annotations

import torch
from torch import Tensor


def first_hits(mask: Tensor, samples: int) -> tuple[Tensor, Tensor]:
    """Columns of the first `samples` true entries of each row of `mask` (M, N), and their number.

    Returns (M, samples) int64, of which row i has `counts[i]` columns in rising order, then 0, and
    counts (M,) int64, at most `samples`.
    """
    counts = mask.sum(dim=1)
    rows, columns = mask.nonzero(as_tuple=True)
    rank = torch.arange(len(rows), device=mask.device) - (counts.cumsum(0) - counts)[rows]
    early = rank < samples
    idx = torch.zeros(len(mask), samples, dtype=torch.int64, device=mask.device)
    idx[rows[early], rank[early]] = columns[early]
    return idx, counts.clamp_max(samples)


def padded_with_first(idx: Tensor, counts: Tensor) -> Tensor:
    """`idx` (M, S) of `first_hits` with its first column repeated behind the `counts` (M,) hits."""
    hit = torch.arange(idx.shape[1], device=idx.device) < counts[:, None]
    return torch.where(hit, idx, idx[:, :1])

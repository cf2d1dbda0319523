"""The first few true positions of every row of a mask, the common end of the neighbour searches."""

import torch
from torch import Tensor


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

"""The permutation test of no association between two samples."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from tracking.coefficients import scores

LARGEST_EXACT = 8
"""Up to this many pairs all permutations are tried: 8! = 40,320."""

_SAMPLED = 9_999
_BLOCK = 4_000_000  # numbers of a block of score vectors, 32 MB


@lru_cache(maxsize=8)
def _orders(n: int, seed: int) -> NDArray[np.int16]:
    """All permutations of n items, or a seeded sample of them, shape (m, n)."""
    if n <= LARGEST_EXACT:
        return np.array(list(permutations(range(n))), dtype=np.int16)
    rows = np.tile(np.arange(n, dtype=np.int16), (_SAMPLED, 1))
    return np.random.default_rng(seed).permuted(rows, axis=1)


def permutation_p(
    x: NDArray[np.float64], y: NDArray[np.float64], coefficient: str, seed: int = 0
) -> NDArray[np.float64]:
    """Two-sided p-value of a coefficient between each row of `x` and `y`.

    The null pairs `y` with `x` in any order. As in `scipy.stats.permutation_test` with pairings,
    the p-value is twice the smaller tail, at most 1. With up to `LARGEST_EXACT` pairs it is exact;
    beyond, from seeded random orders and with one added to both counts (Phipson and Smyth 2010).

    Args:
        x: samples, shape (k, n).
        y: the sample that they are compared with, shape (n,).

    Returns:
        Shape (k,). NaN where a sample is constant.
    """
    n = len(y)
    orders = _orders(n, seed)
    of_x = scores(x, coefficient)
    observed = of_x @ scores(y, coefficient)
    less, greater = np.zeros(len(x), np.int64), np.zeros(len(x), np.int64)
    for block in np.array_split(orders, math.ceil(len(orders) * of_x.shape[1] / _BLOCK)):
        null = scores(y[block], coefficient) @ of_x.T
        # Equal coefficients may differ by rounding, and must count as equal.
        less += (null <= observed + 1e-12).sum(axis=0)
        greater += (null >= observed - 1e-12).sum(axis=0)
    added = 0 if n <= LARGEST_EXACT else 1
    p = 2 * (np.minimum(less, greater) + added) / (len(orders) + added)
    return np.where(np.isnan(observed), np.nan, np.minimum(p, 1.0))


def smallest_p(n: int) -> float:
    """The smallest two-sided p-value that n pairs without ties can give: 2 / n!."""
    return min(1.0, 2 / math.factorial(n))

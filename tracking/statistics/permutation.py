"""The permutation test of no association between two samples."""

import math
from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tracking.statistics.coefficients import scores

LARGEST_EXACT = 8
"""Up to this many pairs all permutations are tried: 8! = 40,320."""

LARGEST_SAMPLED = 100
"""Up to this many pairs permutations are sampled; beyond, scipy's large-sample tests do."""

_SAMPLED = 9_999
_LARGE_SAMPLE = {
    "pearson": stats.pearsonr,
    "spearman": stats.spearmanr,
    "kendall": stats.kendalltau,
}
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
    up to `LARGEST_SAMPLED`, from seeded random orders and with one added to both counts (Phipson
    and Smyth 2010). Where no sampled order is as extreme, that only says that p is below 2e-4: then
    it is scipy's for large samples, no larger than this and no smaller than `smallest_p`. Many
    tests could not be corrected for otherwise.

    Args:
        x: samples, shape (k, n).
        y: the sample that they are compared with, shape (n,).

    Returns:
        Shape (k,). NaN where a sample is constant.
    """
    n = len(y)
    of_x = scores(x, coefficient)
    if n > LARGEST_SAMPLED:
        known = np.isfinite(of_x[:, 0]) & np.isfinite(scores(y, coefficient)[0])
        return _large_sample_p(x, y, coefficient, known)
    orders = _orders(n, seed)
    of_y = scores(y, coefficient)
    observed = of_x @ of_y
    less, greater = np.zeros(len(x), np.int64), np.zeros(len(x), np.int64)
    for block in np.array_split(orders, math.ceil(len(orders) * of_x.shape[1] / _BLOCK)):
        # Unit vectors of values and of ranks are permuted with them; Kendall's, of pairs, are not.
        of_block = scores(y[block], coefficient) if coefficient == "kendall" else of_y[block]
        null = of_block @ of_x.T
        # Equal coefficients may differ by rounding, and must count as equal.
        less += (null <= observed + 1e-12).sum(axis=0)
        greater += (null >= observed - 1e-12).sum(axis=0)
    added = 0 if n <= LARGEST_EXACT else 1
    tail = np.minimum(less, greater)
    p = np.minimum(2 * (tail + added) / (len(orders) + added), 1.0)
    extreme = np.isfinite(observed) & (tail == 0)  # never of all permutations: one is the sample
    if extreme.any():
        tiny = np.maximum(_large_sample_p(x, y, coefficient, extreme), smallest_p(n))
        p = np.where(extreme, np.minimum(p, tiny), p)
    return np.where(np.isnan(observed), np.nan, p)


def _large_sample_p(
    x: NDArray[np.float64], y: NDArray[np.float64], coefficient: str, wanted: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """scipy's two-sided p of the `wanted` rows of `x`, NaN for the others; shape (k,)."""
    test = _LARGE_SAMPLE[coefficient]
    return np.array([test(a, y).pvalue if ok else np.nan for a, ok in zip(x, wanted, strict=True)])


def smallest_p(n: int) -> float:
    """The smallest two-sided p-value that n pairs without ties can give: 2 / n!."""
    return min(1.0, 2 / math.factorial(n))

"""p-values of Spearman's rho and Kendall's tau that need no drawn orders."""

import math
from functools import lru_cache

import numpy as np
from scipy import stats

from tracking.statistics import Values

LARGEST_EXACT_RHO = 12
"""Most pairs for which the null of rho is counted: 17 MB, 0.05 s."""

LARGEST_EXACT_TAU = 100
"""Most pairs for which the null of tau is counted; beyond, it counts as normal."""


def rank_test_p(x: Values, y: Values, coefficient: str) -> Values:
    """Compute the two-sided p-value (twice the smaller tail) of each row of x (k, n) with y (n,).

    Exact where the null can be counted: for rho if there are no ties, for tau if at most one of
    both samples has ties. For tau beyond `LARGEST_EXACT_TAU` pairs it is scipy's for large samples,
    as a random order of n (n - 1) / 2 signs takes too long. NaN elsewhere, and for Pearson's r."""
    n, p = len(y), np.full(len(x), np.nan)
    if coefficient == "kendall" and n > LARGEST_EXACT_TAU:
        return np.array([stats.kendalltau(row, y, method="asymptotic").pvalue for row in x])
    ties_of_y = _ties(y)
    for i, row in enumerate(x):
        fewer, more = sorted((_ties(row), ties_of_y))
        if coefficient == "spearman" and n <= LARGEST_EXACT_RHO and max(more) == 1:
            total = int(stats.rankdata(row) @ stats.rankdata(y))
            lower = min(total, n * (n + 1) ** 2 // 2 - total)  # the null is symmetric
            p[i] = min(2 * lower_tail_of_rho(n)[lower], 1.0)
        elif coefficient == "kendall" and max(fewer) == 1:
            higher = row[:, None] < row
            lower = min((higher & (y[:, None] < y)).sum(), (higher & (y[:, None] > y)).sum())
            p[i] = min(2 * lower_tail_of_tau(more)[lower], 1.0)
    return p


def _ties(values: Values) -> tuple[int, ...]:
    """Count how often each number occurs, the most frequent first."""
    return tuple(sorted(np.unique(values, return_counts=True)[1].tolist(), reverse=True))


@lru_cache(maxsize=4)
def lower_tail_of_rho(n: int) -> Values:
    """Compute the share of permutations of n whose sum of i times the i-th is at most the index.

    The sums are counted over the sets of numbers that the first positions use."""
    most = n * (n + 1) * (2 * n + 1) // 6
    counts = np.zeros((2**n, most + 1), dtype=np.int64)
    counts[0, 0] = 1
    for used in range(1, 2**n):
        for number in range(1, n + 1):
            before = used & ~(1 << (number - 1))
            if before != used:
                added = number * used.bit_count()
                counts[used, added:] += counts[before, :-added]
    return np.asarray(counts[-1].cumsum() / math.factorial(n))


@lru_cache(maxsize=16)
def lower_tail_of_tau(ties: tuple[int, ...]) -> Values:
    """Compute the share of orders of tied numbers with at most as many inversions as the index.

    Their numbers are the coefficients of Gauss's multinomial, in exact integers (Kendall 1945)."""
    n = sum(ties)
    counts = np.zeros(math.comb(n, 2) - sum(math.comb(t, 2) for t in ties) + 1, dtype=object)
    counts[0] = 1
    for i in range(1, n + 1):  # times 1 - q^i
        counts[i:] = counts[i:] - counts[:-i]
    for i in (i for t in ties for i in range(1, t + 1)):  # over 1 - q^i
        for start in range(i):
            counts[start::i] = counts[start::i].cumsum()
    tail = counts.cumsum()
    return np.asarray(tail / tail[-1], dtype=np.float64)

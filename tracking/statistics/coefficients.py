"""Pearson's r, Spearman's rho and Kendall's tau, their permutation tests, and many of these."""

import math
from functools import lru_cache, partial
from itertools import permutations
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lidarplace.base.errors import InputError
from tracking.statistics import Values
from tracking.statistics.rank_tests import rank_test_p

COEFFICIENTS = ("pearson", "spearman", "kendall")


def scores(values: Values, coefficient: str) -> Values:
    """Compute unit vectors whose inner product is the coefficient of two samples.

    `pearson`: the centred values; `spearman`: the centred ranks, ties share their mean rank;
    `kendall`: the signs of all differences `values[j] - values[i]`, i < j, which makes the inner
    product tau-b (Kendall 1945). So permutations and resamples are matrix products. `values` have
    samples along the last axis, shape (..., n), as have the vectors, for `kendall` of n (n - 1) / 2
    numbers. NaN where a sample is constant."""
    if coefficient == "kendall":
        i, j = np.triu_indices(values.shape[-1], 1)
        vectors = np.sign(values[..., j] - values[..., i])
        rounding = np.zeros(vectors.shape[:-1])
    elif coefficient in COEFFICIENTS:
        # Numbers near 1e300 or 1e-300 have no squares: the largest becomes 1.
        peak = np.abs(values).max(axis=-1, keepdims=True)
        scaled = values / np.where(peak > 0, peak, 1.0)
        sample = stats.rankdata(values, axis=-1) if coefficient == "spearman" else scaled
        vectors = sample - sample.mean(axis=-1, keepdims=True)
        # The mean of equal numbers may be off by a rounding: such a rest is no spread.
        rounding = 1e-13 * np.abs(sample).sum(axis=-1)
    else:
        wanted = " or ".join(COEFFICIENTS)
        raise InputError(key="coefficient", expected=wanted, found=repr(coefficient))
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > rounding[..., None], length, np.nan)


LARGEST_EXACT = 8  # up to this many pairs all permutations are tried: 8! = 40,320

_SAMPLED = 9_999  # random orders of every test
_MOST_SAMPLED = 499_999  # random orders of a test that few of the first are as extreme as
_MOST_NUMBERS = 50_000_000  # in all these orders, 100 MB
_FEW = 20
_BLOCK = 200_000  # multiplications at a time: one thread does them in its cache


@lru_cache(maxsize=6)
def _orders(n: int, count: int, seed: int) -> NDArray[np.int16]:
    """Return all permutations of n items, or a seeded sample of `count` if fewer, shape (m, n)."""
    if n <= LARGEST_EXACT or math.factorial(n) <= count:
        return np.array(list(permutations(range(n))), dtype=np.int16)
    rows = np.tile(np.arange(n, dtype=np.int16), (count, 1))
    return np.random.default_rng(seed).permuted(rows, axis=1)


def _most_orders(numbers: int) -> int:
    """Limit the number of random orders, each of so many numbers."""
    return min(max(_MOST_NUMBERS // numbers, _SAMPLED), _MOST_SAMPLED)


def permutation_p(x: Values, y: Values, coefficient: str, seed: int = 0) -> Values:
    """Compute the two-sided p-value of a coefficient between each row of `x` and `y`.

    The null pairs `y` with `x` in any order. As in `scipy.stats.permutation_test` with pairings,
    the p-value is twice the smaller tail, at most 1. It is exact with up to `LARGEST_EXACT` pairs
    and where `rank_test_p` can count. Elsewhere it is from seeded random orders, with one added to
    both counts (Phipson and Smyth 2010): never below what was drawn.

    `_SAMPLED` orders come first. If fewer than `_FEW` are as extreme, up to `_MOST_SAMPLED` replace
    them. The result is valid: p <= a implies that the p-value of the first orders is at most a,
    too, or, where a is below that of `_FEW`, that the p-value of the others is. `x` has shape
    (k, n), `y` (n,), the result (k,), NaN where a sample is constant."""
    of_x, of_y = scores(x, coefficient), scores(y, coefficient)
    observed = of_x @ of_y
    p, rows = np.full(len(x), np.nan), np.flatnonzero(np.isfinite(observed))
    p[rows] = rank_test_p(x[rows], y, coefficient)
    rows = rows[np.isnan(p[rows])]
    for count in (_SAMPLED, _most_orders(len(of_y))):
        if len(rows):
            orders = _orders(len(y), count, seed)
            tail = _smaller_tail(of_x[rows], y, coefficient, orders, observed[rows])
            added = int(len(orders) == count)  # all permutations include the observed one
            p[rows] = np.minimum(2 * (tail + added) / (len(orders) + added), 1.0)
            rows = rows[(tail < _FEW) & bool(added)]
    return p


def _smaller_tail(
    of_x: Values, y: Values, coefficient: str, orders: NDArray[np.int16], observed: Values
) -> NDArray[np.int64]:
    """Count the orders of `y` with a coefficient as low, or as high, whichever are fewer."""
    of_y = scores(y, coefficient)
    less, greater = np.zeros((2, len(of_x)), np.int64)
    length = max(_BLOCK // of_x.size, 1)
    for start in range(0, len(orders), length):
        block = orders[start : start + length]
        # Unit vectors of values and of ranks are permuted with them; Kendall's, of pairs, are not.
        of_block = scores(y[block], coefficient) if coefficient == "kendall" else of_y[block]
        null = of_x @ of_block.T
        # Equal coefficients may differ by rounding, and must count as equal.
        less += (null <= observed[:, None] + 1e-12).sum(axis=1)
        greater += (null >= observed[:, None] - 1e-12).sum(axis=1)
    return np.minimum(less, greater)


def smallest_p(n: int) -> float:
    """Return the smallest two-sided p-value for n pairs, by 2 / n! and the number of draws."""
    return max(min(1.0, 2 / math.factorial(n)), 2 / (_most_orders(n) + 1))


def holm(p: Values) -> Values:
    """Adjust p-values family-wise (Holm 1979), shape (m,), finite, however they depend."""
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    return np.minimum(adjusted, 1.0)


def adjust(p: Values, counted_as: NDArray[np.intp], method: Literal["holm", "fdr"]) -> Values:
    """Adjust the p-values of a family in which some tests occur twice; NaN where there was none.

    `counted_as` has the index of the test that counts: its own, or that of the same one. `fdr` is
    the expected share of false discoveries (Benjamini and Yekutieli 2001), also of dependent tests.
    """
    counts = np.isfinite(p) & (counted_as == np.arange(len(p)))
    adjusted = np.full(len(p), np.nan)
    if counts.any():
        by_method = (
            holm if method == "holm" else partial(stats.false_discovery_control, method="by")
        )
        adjusted[counts] = by_method(p[counts])
    return adjusted[counted_as]


def distinct_tests(x: Values, coefficient: str) -> NDArray[np.intp]:
    """Find for each sample of `x`, shape (k, n), the first one whose tests give the same p-value.

    Their unit vectors are equal or opposite. A constant sample points to itself."""
    vectors = scores(x, coefficient)
    same = np.abs(vectors @ vectors.T) > 1 - 1e-9
    np.fill_diagonal(same, True)
    return np.asarray(np.argmax(same, axis=1))

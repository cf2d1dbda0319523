"""Pearson's r, Spearman's rho and Kendall's tau, their permutation tests, and many of these."""

import math
from functools import lru_cache
from itertools import permutations
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lidarplace.base.errors import InputError
from tracking.statistics import Values

COEFFICIENTS = ("pearson", "spearman", "kendall")


def scores(values: Values, coefficient: str) -> Values:
    """Unit vectors whose inner product is the coefficient of two samples.

    `pearson`: the centred values; `spearman`: the centred ranks, ties share their mean rank;
    `kendall`: the signs of all differences `values[j] - values[i]`, i < j, which makes the inner
    product tau-b (Kendall 1945). So permutations and resamples are matrix products. `values` have
    samples along the last axis, shape (..., n), as have the vectors, for `kendall` of n (n - 1) / 2
    numbers. NaN where a sample is constant.
    """
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

LARGEST_SAMPLED = 100
"""Up to this many pairs permutations are sampled; beyond, scipy's large-sample tests do."""

_SAMPLED = 9_999
_LARGE_SAMPLE = dict(
    zip(COEFFICIENTS, (stats.pearsonr, stats.spearmanr, stats.kendalltau), strict=True)
)
_BLOCK = 4_000_000  # numbers of a block of score vectors, 32 MB


@lru_cache(maxsize=8)
def _orders(n: int, seed: int) -> NDArray[np.int16]:
    """All permutations of n items, or a seeded sample of them, shape (m, n)."""
    if n <= LARGEST_EXACT:
        return np.array(list(permutations(range(n))), dtype=np.int16)
    rows = np.tile(np.arange(n, dtype=np.int16), (_SAMPLED, 1))
    return np.random.default_rng(seed).permuted(rows, axis=1)


def permutation_p(x: Values, y: Values, coefficient: str, seed: int = 0) -> Values:
    """Two-sided p-value of a coefficient between each row of `x` and `y`.

    The null pairs `y` with `x` in any order. As in `scipy.stats.permutation_test` with pairings,
    the p-value is twice the smaller tail, at most 1. With up to `LARGEST_EXACT` pairs it is exact;
    up to `LARGEST_SAMPLED`, from seeded random orders and with one added to both counts (Phipson
    and Smyth 2010). Where no sampled order is as extreme, it is scipy's for large samples, no
    larger than this and no smaller than `smallest_p`, or many tests could not be corrected for. `x`
    has shape (k, n), `y` (n,), the result (k,), NaN where a sample is constant.
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


def _large_sample_p(x: Values, y: Values, coefficient: str, wanted: NDArray[np.bool_]) -> Values:
    """scipy's two-sided p of the `wanted` rows of `x`, NaN for the others; shape (k,)."""
    test = _LARGE_SAMPLE[coefficient]
    return np.array([test(a, y).pvalue if ok else np.nan for a, ok in zip(x, wanted, strict=True)])


def smallest_p(n: int) -> float:
    """The smallest two-sided p-value that n pairs without ties can give: 2 / n!."""
    return min(1.0, 2 / math.factorial(n))


def holm(p: Values) -> Values:
    """p-values, shape (m,), finite, adjusted family-wise (Holm 1979), however they depend."""
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
        own = p[counts]
        found = holm(own) if method == "holm" else stats.false_discovery_control(own, method="by")
        adjusted[counts] = found
    return adjusted[counted_as]


def distinct_tests(x: Values, coefficient: str) -> NDArray[np.intp]:
    """For each sample of `x`, shape (k, n), the first one whose tests give the same p-value.

    Their unit vectors are equal or opposite. A constant sample points to itself.
    """
    vectors = scores(x, coefficient)
    same = np.abs(vectors @ vectors.T) > 1 - 1e-9
    np.fill_diagonal(same, True)
    return np.asarray(np.argmax(same, axis=1))

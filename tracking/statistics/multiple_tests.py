"""p-values of many tests at once, adjusted for their number."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tracking.statistics.coefficients import scores


def holm(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """p-values adjusted family-wise (Holm 1979): the chance of any false discovery.

    Valid however the tests depend on each other.

    Args:
        p: shape (m,), finite.
    """
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    return np.minimum(adjusted, 1.0)


def adjust(
    p: NDArray[np.float64], counted_as: NDArray[np.intp], method: Literal["holm", "fdr"]
) -> NDArray[np.float64]:
    """Adjust the p-values of a family in which some tests occur twice.

    Args:
        p: shape (m,); NaN where there was no test.
        counted_as: shape (m,), the index of the test that counts: its own, or that of the same one.
        method: `holm`, or `fdr`: the expected share of false discoveries (Benjamini and Yekutieli
            2001), valid for dependent tests too.

    Returns:
        Shape (m,), NaN where `p` is.
    """
    counts = np.isfinite(p) & (counted_as == np.arange(len(p)))
    adjusted = np.full(len(p), np.nan)
    if counts.any():
        own = p[counts]
        found = holm(own) if method == "holm" else stats.false_discovery_control(own, method="by")
        adjusted[counts] = found
    return adjusted[counted_as]


def distinct_tests(x: NDArray[np.float64], coefficient: str) -> NDArray[np.intp]:
    """For each sample, the first one whose tests give the same p-value whatever the metric.

    Two samples are one test if their unit vectors (`coefficients.scores`) are equal or opposite.

    Args:
        x: samples, shape (k, n).

    Returns:
        Shape (k,), indices into `x`. A constant sample points to itself.
    """
    vectors = scores(x, coefficient)
    same = np.abs(vectors @ vectors.T) > 1 - 1e-9
    np.fill_diagonal(same, True)
    return np.asarray(np.argmax(same, axis=1))

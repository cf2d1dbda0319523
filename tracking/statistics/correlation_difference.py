"""How much stronger does one surrogate go with a metric than others? Intervals for all at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tracking.statistics.coefficients import scores
from tracking.statistics.confidence_interval import corrected, intervals
from tracking.statistics.reliability import seed_mean


def strength_leads(
    x: NDArray[np.float64], y: NDArray[np.float64], coefficient: str = "spearman"
) -> NDArray[np.float64]:
    """95 % intervals of the first \\|coefficient\\| less each other, for all pairs at once.

    The samples share their placements and the metric, so their coefficients go together. Both have
    the interval of `tracking.statistics.confidence_interval.intervals`; Zou (2007) makes of these
    the interval of their difference, with the correlation of two sample correlations in normal
    populations (Olkin and Siotani 1976), for ranks as an approximation. Every sample is turned so
    that its coefficient is positive, and may then be negative in the population: a bound at 0 would
    miss surrogates that are worth nothing.

    The strongest was chosen from the same results. So the level is that of the studentized range
    of so many surrogates, as for the leads of the best placement; two have no such price.

    Args:
        x: a row a surrogate, shape (..., k, n).
        y: one row a placement, one column a seed, shape (..., n, seeds).

    Returns:
        Shape (..., k - 1, 2). NaN for fewer than 4 placements and constants.
    """
    of_x, of_y = scores(x, coefficient), scores(seed_mean(y), coefficient)
    found = (of_x * of_y[..., None, :]).sum(axis=-1)
    sign = np.where(found < 0, -1.0, 1.0)
    level = _simultaneous_level(x.shape[-2])
    bounds = intervals(sign[..., None] * x, y[..., None, :, :], coefficient, level)
    strength = np.abs(found)
    estimate = np.clip(corrected(strength, y, coefficient), bounds[..., 0], bounds[..., 1])
    between = (of_x[..., :1, :] * of_x[..., 1:, :]).sum(axis=-1) * sign[..., :1] * sign[..., 1:]
    together = correlation_of_correlations(strength[..., :1], strength[..., 1:], between)
    return difference(
        (estimate[..., :1], *np.moveaxis(bounds[..., :1, :], -1, 0)),
        (estimate[..., 1:], *np.moveaxis(bounds[..., 1:, :], -1, 0)),
        together,
    )


def difference(
    one: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    two: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    together: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Zou's interval of the difference of two estimates, within what two strengths can differ by.

    Args:
        one, two: estimate, lower and upper bound, of the same level.
        together: correlation of the two estimates.

    Returns:
        Shape (..., 2).
    """
    (a, a_low, a_high), (b, b_low, b_high) = one, two

    def distance(of_a: NDArray[np.float64], of_b: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sqrt(np.maximum(of_a**2 + of_b**2 - 2 * together * of_a * of_b, 0.0))

    low = a - b - distance(a - a_low, b_high - b)
    high = a - b + distance(a_high - a, b - b_low)
    return np.clip(np.stack([low, high], axis=-1), -1.0, 1.0)


def correlation_of_correlations(
    one: NDArray[np.float64], two: NDArray[np.float64], between: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Correlation of the sample correlations of two variables with a third.

    Args:
        one, two: their correlations with the third, not negative.
        between: that of the two.
    """
    # The limit for a perfect order, where numerator and denominator vanish.
    one, two = np.minimum(one, 1 - 1e-6), np.minimum(two, 1 - 1e-6)
    rest = 1 - one**2 - two**2 - between**2
    top = (between - one * two / 2) * rest + between**3
    return np.clip(top / ((1 - one**2) * (1 - two**2)), -1.0, 1.0)


@lru_cache(maxsize=64)
def _simultaneous_level(count: int) -> float:
    """Level of one interval so that those of all pairs of `count` estimates hold with 95 %."""
    if count < 2:
        return 0.95
    reach = stats.studentized_range.ppf(0.95, count, np.inf) / np.sqrt(2)
    return float(2 * stats.norm.cdf(reach) - 1)

"""95 % intervals of a correlation, and of how much stronger one is than another."""

from functools import lru_cache

import numpy as np
from scipy import stats

from tracking.statistics import Values
from tracking.statistics.coefficients import scores
from tracking.statistics.reliability import SeedFit, reliability, without_seeds

LEAST_RELIABLE = 0.25
"""Reliability of the means below which its estimate is not trusted to correct by."""

LEAST_PLACEMENTS = 4  # with fewer, Fisher's z has no standard error


def intervals(x: Values, y: Values, coefficient: str, confidence: float = 0.95) -> Values:
    """Compute the interval of the correlation of `x` with the expectation of `y` over seeds.

    Placements are a sample, and so are the seeds. Two steps, both on the scale of a normal
    population's Pearson correlation:

    1. The coefficient with the means `without_seeds` has a normal interval of Fisher's z. Its
       error is `pearson`: 1 / sqrt(n - 3), or by the influence function if that is larger, as for
       heavy tails; `spearman`: sqrt((1 + rho^2 / 2) / (n - 3)) (Bonett and Wright 2000); `kendall`:
       from tau's exact variance in a bivariate normal population (Esscher 1924). A perfect order
       counts as half a step below 1, as a population in which tau is 0.9 often gives one.
    2. The seeds' noise lowers that coefficient by the root of the means' reliability (Spearman
       1904). The interval is that of the ratio of both (`_ratio_interval`), if a placement has two
       seeds. The coefficient with the means and its ratio to the root are inside.

    `x` has shape (..., n), `y` a row a placement and a column a seed, (..., n, seeds), NaN where
    one is missing; leading axes broadcast. Lower and upper bound, shape (..., 2), NaN for fewer
    than 4 placements and constants."""
    fit = without_seeds(y)
    u, v = scores(x, coefficient), scores(fit.means, coefficient)
    coefficients = (u * v).sum(axis=-1)
    n = y.shape[-2]
    if n < LEAST_PLACEMENTS:
        return np.full((*coefficients.shape, 2), np.nan)
    step = {"pearson": 1e-12, "spearman": 6 / (n * (n**2 - 1)), "kendall": 2 / (n * (n - 1))}
    inner = np.clip(coefficients, step[coefficient] - 1, 1 - step[coefficient])
    reach = stats.norm.ppf((1 + confidence) / 2)
    half = reach * _standard_error(inner, u, v, coefficient, n)
    z = np.arctanh(inner)
    bounds = to_normal(np.tanh(np.stack([z - half, z + half], axis=-1)), coefficient)
    bounds = _ratio_interval(to_normal(inner, coefficient), bounds, y, fit, confidence)
    bounds = from_normal(bounds, coefficient)
    perfect = np.abs(coefficients) > 1 - 1e-9
    bounds[..., 0] = np.where(perfect & (coefficients < 0), -1.0, bounds[..., 0])
    bounds[..., 1] = np.where(perfect & (coefficients > 0), 1.0, bounds[..., 1])
    return bounds


def corrected(r: Values, y: Values, coefficient: str) -> Values:
    """Free coefficients, shape (..., m), with the mean of `y` over seeds, from the seeds' noise.

    In [-1, 1]; unchanged where no placement has two seeds. `y` as for `intervals`."""
    lowered = _lowered_by(y, without_seeds(y), 0.95)[..., :1]
    return from_normal(np.clip(to_normal(r, coefficient) / lowered, -1, 1), coefficient)


def _lowered_by(y: Values, fit: SeedFit, confidence: float) -> Values:
    """Compute the root of the reliability of means over seeds, with its interval, shape (..., 3).

    1 where no placement has two seeds. The value is at least the root of `LEAST_RELIABLE`."""
    share = (1 / np.maximum(np.isfinite(y).sum(axis=-1), 1)).mean(axis=-1)
    reliabilities = reliability(fit.means, fit.variance * share, fit.degrees, confidence)
    value, low, high = np.moveaxis(np.sqrt(np.nan_to_num(reliabilities, nan=1.0)), -1, 0)
    value = np.maximum(value, np.sqrt(LEAST_RELIABLE))
    return np.stack([value, np.minimum(low, value), np.maximum(high, value)], axis=-1)


def _ratio_interval(
    r: Values, bounds: Values, y: Values, fit: SeedFit, confidence: float
) -> Values:
    """Compute the interval of `r` over the root of the means' reliability, from that of each.

    By the recovery of variances from intervals (Donner and Zou 2012): R is inside if r - R root is
    no farther from 0 than the distances of both to their bounds allow, which is a quadratic in R.
    Their errors go together, since placements that happen to differ more raise both: in normal
    populations by r / sqrt(2 (1 + (n - 1) / degrees)), to first order. The errors of ranks are
    larger, and the rest of them has nothing to do with the spread. `r` are Pearson correlations in
    (-1, 1), shape (...,)."""
    root, least, most = np.moveaxis(_lowered_by(y, fit, confidence), -1, 0)
    n = y.shape[-2]
    sign = np.where(r < 0, -1.0, 1.0)
    size, bounds = np.abs(r), sign[..., None] * bounds
    low, high = bounds.min(axis=-1), bounds.max(axis=-1)
    reach = stats.norm.ppf((1 + confidence) / 2) / np.sqrt(n - 3)
    normal = np.tanh(np.arctanh(size) + reach) - np.tanh(np.arctanh(size) - reach)
    together = size / np.sqrt(2 * (1 + (n - 1) / np.maximum(fit.degrees, 1)))
    together = together * np.minimum(normal / (high - low), 1.0)

    def bound(off: Values, other: Values, together: Values, side: int) -> Values:
        centre = size * root - together * off * other
        square, rest = root**2 - other**2, size**2 - off**2
        reached = np.sqrt(np.maximum(centre**2 - square * rest, 0.0))
        is_bounded = square > 1e-9  # else the reliability may be 0, and the ratio anything
        return np.where(
            is_bounded, (centre + side * reached) / np.where(is_bounded, square, 1.0), side
        )

    # A ratio below 0 is the farther from 0 the less reliable the means are.
    is_positive = low >= 0
    of_root = np.where(is_positive, most - root, root - least)
    lower = bound(size - low, of_root, np.where(is_positive, together, -together), -1)
    upper = bound(high - size, root - least, together, 1)
    ratio = np.minimum(size / root, 1.0)
    lower = np.minimum(np.clip(lower, -1, 1), np.minimum(size, ratio))
    upper = np.maximum(np.clip(upper, -1, 1), ratio)
    turned = np.stack([lower, upper], axis=-1) * sign[..., None]
    return np.sort(turned, axis=-1)


def _standard_error(r: Values, u: Values, v: Values, coefficient: str, n: int) -> Values:
    """Compute the standard error of Fisher's z of a coefficient `r` of unit vectors `u` and `v`."""
    if coefficient == "spearman":
        return np.sqrt((1 + r**2 / 2) / (n - 3))
    if coefficient == "kendall":
        normal = to_normal(r, coefficient)
        one, two = np.arcsin(normal) / np.pi, np.arcsin(normal / 2) / np.pi
        variance = 1 - 4 * one**2 + 2 * (n - 2) * (1 / 9 - 4 * two**2)
        return np.sqrt(2 / (n * (n - 1)) * variance) / (1 - r**2)
    influence = u * v - r[..., None] * (u**2 + v**2) / 2
    sandwich = np.sqrt(n / (n - 1) * (influence**2).sum(axis=-1)) / (1 - r**2)
    return np.asarray(np.maximum(1 / np.sqrt(n - 3), sandwich))


def to_normal(r: Values, coefficient: str) -> Values:
    """Convert a coefficient to Pearson's correlation of the normal population that has it."""
    if coefficient == "spearman":
        return 2 * np.sin(np.pi * r / 6)
    return np.sin(np.pi * r / 2) if coefficient == "kendall" else r


def from_normal(r: Values, coefficient: str) -> Values:
    """Convert Pearson's correlation of a normal population to the coefficient; see `to_normal`."""
    if coefficient == "spearman":
        return 6 / np.pi * np.arcsin(r / 2)
    return 2 / np.pi * np.arcsin(r) if coefficient == "kendall" else r


def strength_leads(x: Values, y: Values) -> Values:
    r"""Compute 95 % intervals of the first \|ρ\| less each other, for all pairs at once.

    The samples share their placements and the metric, so their ρ go together. Zou (2007)
    makes of their `intervals` that of their difference, with the correlation of two sample
    correlations in normal populations (Olkin and Siotani 1976), for ranks as an approximation.
    Every sample is turned so that its coefficient is positive, and may then be negative in the
    population: a bound at 0 would miss surrogates that are worth nothing. The strongest was chosen
    from the same results, so the level is that of the studentized range of so many surrogates.
    `x` has a row a surrogate, shape (..., k, n), `y` is that of `intervals`; the result has shape
    (..., k - 1, 2)."""
    of_x, of_y = scores(x, "spearman"), scores(without_seeds(y).means, "spearman")
    coefficients = (of_x * of_y[..., None, :]).sum(axis=-1)
    sign = np.where(coefficients < 0, -1.0, 1.0)
    level = _simultaneous_level(x.shape[-2])
    bounds = intervals(sign[..., None] * x, y[..., None, :, :], "spearman", level)
    strength = np.abs(coefficients)
    estimate = np.clip(corrected(strength, y, "spearman"), bounds[..., 0], bounds[..., 1])
    between = (of_x[..., :1, :] * of_x[..., 1:, :]).sum(axis=-1) * sign[..., :1] * sign[..., 1:]
    together = correlation_of_correlations(strength[..., :1], strength[..., 1:], between)
    return difference(
        (estimate[..., :1], *np.moveaxis(bounds[..., :1, :], -1, 0)),
        (estimate[..., 1:], *np.moveaxis(bounds[..., 1:, :], -1, 0)),
        together,
    )


def difference(
    one: tuple[Values, Values, Values], two: tuple[Values, Values, Values], together: Values
) -> Values:
    """Compute Zou's interval, shape (..., 2), of the difference of two estimates, within [-1, 1].

    `one` and `two` are estimate, lower and upper bound; `together` is their correlation."""
    (a, a_low, a_high), (b, b_low, b_high) = one, two

    def distance(of_a: Values, of_b: Values) -> Values:
        return np.sqrt(np.maximum(of_a**2 + of_b**2 - 2 * together * of_a * of_b, 0.0))

    low = a - b - distance(a - a_low, b_high - b)
    high = a - b + distance(a_high - a, b - b_low)
    return np.clip(np.stack([low, high], axis=-1), -1.0, 1.0)


def correlation_of_correlations(one: Values, two: Values, between: Values) -> Values:
    """Correlate two sample correlations, not negative, with a third; `between` the two."""
    # The limit for a perfect order, where numerator and denominator vanish.
    one, two = np.minimum(one, 1 - 1e-6), np.minimum(two, 1 - 1e-6)
    rest = 1 - one**2 - two**2 - between**2
    top = (between - one * two / 2) * rest + between**3
    return np.clip(top / ((1 - one**2) * (1 - two**2)), -1.0, 1.0)


@lru_cache(maxsize=64)
def _simultaneous_level(count: int) -> float:
    """Compute the level at which the intervals of all pairs of `count` estimates hold with 95 %."""
    if count < 2:
        return 0.95
    reach = stats.studentized_range.ppf(0.95, count, np.inf) / np.sqrt(2)
    return float(2 * stats.norm.cdf(reach) - 1)

"""95 % confidence intervals of a correlation: normal theory, corrected for the seeds' noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tracking.statistics.coefficients import scores
from tracking.statistics.reliability import icc, reliability_of_mean, seed_mean

LEAST_RELIABLE = 0.25
"""Reliability of the means below which its estimate is not trusted to correct by."""

LEAST_PLACEMENTS = 4
"""With fewer, Fisher's z has no standard error."""


def intervals(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    coefficient: str,
    confidence: float = 0.95,
) -> NDArray[np.float64]:
    """Interval of the correlation of `x` with the expectation of `y` over seeds.

    Placements are a sample, and so are the seeds within each. The first level is a normal interval
    of Fisher's z, whose standard error is

    - `pearson`: 1 / sqrt(n - 3), or by the influence function if that is larger, which it is for
      heavy tails;
    - `spearman`: sqrt((1 + rho^2 / 2) / (n - 3)) (Bonett and Wright 2000);
    - `kendall`: from tau's exact variance in a bivariate normal population (Esscher 1924).

    A perfect order counts as half a step below 1, since a population in which tau is 0.9 often
    gives one. The second level: the noise of a mean over seeds lowers every coefficient by
    the root of the mean's reliability. Both bounds are divided by that (Spearman 1904), on the
    scale of a normal population's Pearson correlation, if a placement has two seeds.

    Args:
        x: samples, shape (..., n).
        y: one row a placement, one column a seed, shape (..., n, seeds), NaN where a seed is
            missing; leading axes broadcast with those of `x`.

    Returns:
        Lower and upper bound, shape (..., 2). NaN for fewer than 4 placements and constants.
    """
    mean = seed_mean(y)
    u, v = scores(x, coefficient), scores(mean, coefficient)
    found = (u * v).sum(axis=-1)
    n = mean.shape[-1]
    if n < LEAST_PLACEMENTS:
        return np.full((*found.shape, 2), np.nan)
    step = {"pearson": 1e-12, "spearman": 6 / (n * (n**2 - 1)), "kendall": 2 / (n * (n - 1))}
    inner = np.clip(found, step[coefficient] - 1, 1 - step[coefficient])
    half = stats.norm.ppf((1 + confidence) / 2) * _standard_error(inner, u, v, coefficient, n)
    z = np.arctanh(inner)
    bounds = np.tanh(np.stack([z - half, z + half], axis=-1))
    bounds = corrected(bounds, y, coefficient)
    perfect = np.abs(found) > 1 - 1e-9
    bounds[..., 0] = np.where(perfect & (found < 0), -1.0, bounds[..., 0])
    bounds[..., 1] = np.where(perfect & (found > 0), 1.0, bounds[..., 1])
    return bounds


def corrected(
    r: NDArray[np.float64], y: NDArray[np.float64], coefficient: str
) -> NDArray[np.float64]:
    """Coefficients with the mean of `y` over seeds, freed from what the seeds' noise lowers.

    Args:
        r: shape (..., m).
        y: shape (..., n, seeds), as for `intervals`.

    Returns:
        Shape (..., m), in [-1, 1]. Unchanged where no placement has two seeds.
    """
    seeds = stats.hmean(np.maximum(np.isfinite(y).sum(axis=-1), 1), axis=-1)
    reliable = np.nan_to_num(reliability_of_mean(icc(y), seeds), nan=1.0)
    lowered = np.sqrt(np.maximum(reliable, LEAST_RELIABLE))[..., None]
    return from_normal(np.clip(to_normal(r, coefficient) / lowered, -1, 1), coefficient)


def _standard_error(
    r: NDArray[np.float64],
    u: NDArray[np.float64],
    v: NDArray[np.float64],
    coefficient: str,
    n: int,
) -> NDArray[np.float64]:
    """Standard error of Fisher's z of a coefficient `r`; `u` and `v` are its unit vectors."""
    if coefficient == "spearman":
        return np.sqrt((1 + r**2 / 2) / (n - 3))
    if coefficient == "kendall":
        normal = to_normal(r, coefficient)
        one, two = np.arcsin(normal) / np.pi, np.arcsin(normal / 2) / np.pi
        variance = 1 - 4 * one**2 + 2 * (n - 2) * (1 / 9 - 4 * two**2)
        return np.sqrt(2 / (n * (n - 1)) * variance) / (1 - r**2)
    influence = u * v - r[..., None] * (u**2 + v**2) / 2
    sandwich = np.sqrt(n / (n - 1) * (influence**2).sum(axis=-1)) / (1 - r**2)
    return np.maximum(1 / np.sqrt(n - 3), sandwich)


def to_normal(r: NDArray[np.float64], coefficient: str) -> NDArray[np.float64]:
    """Pearson's correlation of the normal population whose coefficient is `r`."""
    if coefficient == "spearman":
        return 2 * np.sin(np.pi * r / 6)
    return np.sin(np.pi * r / 2) if coefficient == "kendall" else r


def from_normal(r: NDArray[np.float64], coefficient: str) -> NDArray[np.float64]:
    """Inverse of `to_normal`."""
    if coefficient == "spearman":
        return 6 / np.pi * np.arcsin(r / 2)
    return 2 / np.pi * np.arcsin(r) if coefficient == "kendall" else r

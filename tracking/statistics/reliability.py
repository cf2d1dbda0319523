"""Reliability of a metric: the share of its spread between placements that is not seeds' noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from tracking.statistics import Values


@dataclass(frozen=True)
class Noise:
    """Noise of means over seeds: the variance of a mean is `variance / counts`."""

    counts: Values  # seeds of every placement, shape (n,)
    variance: float  # of one seed's value; NaN without degrees of freedom
    degrees: float  # its degrees of freedom
    # sd of what a seed adds to all placements alike, which is in no difference between them; NaN
    # where placements have different seeds
    seed_sd: float = float("nan")

    @classmethod
    def of(cls, y: Values) -> Noise:
        """Estimate the noise of differences between placements; `y` has shape (n, seeds).

        By `without_seeds` where all placements have the same seeds, else by `pooled_variance`."""
        counts = np.isfinite(y).sum(axis=1).astype(np.float64)
        paired = _crossed(y)
        variance, degrees = without_seeds(y)[1:] if paired else pooled_variance(y)
        between = float(np.var(y.mean(axis=0), ddof=1)) if paired else np.nan
        seed_sd = np.sqrt(max(between - float(variance) / len(y), 0.0)) if paired else np.nan
        return cls(counts, float(variance), float(degrees), float(seed_sd))

    @classmethod
    def of_each(cls, y: Values) -> Noise:
        """Estimate the noise of the means, with what a seed adds to all placements alike.

        The variance is `pooled_variance`. Where all placements have the same seeds, its degrees of
        freedom are Satterthwaite's, of the mean squares of a two-way analysis of variance: those of
        the seeds if their effect is large. `y` has shape (n, seeds), NaN where one is missing."""
        variance, degrees = pooled_variance(y)
        noise = cls.of(y)
        if noise.degrees and _crossed(y):
            n, seeds = y.shape
            of_seeds = n * float(np.var(y.mean(axis=0), ddof=1))
            squares = of_seeds**2 + (n - 1) * noise.variance**2
            if squares > 0:
                whole = of_seeds + (n - 1) * noise.variance
                degrees = (seeds - 1) * whole**2 / squares
        return cls(noise.counts, float(variance), float(degrees), noise.seed_sd)

    @property
    def of_mean(self) -> float:
        """Variance of a mean over seeds, averaged over the placements."""
        return self.variance * float(np.mean(1 / self.counts))


class SeedFit(NamedTuple):
    """Means of placements without the effects of seeds, and the noise of one value."""

    means: Values  # shape (..., n)
    variance: Values  # of one value, shape (...,); NaN without degrees of freedom
    degrees: Values  # its degrees of freedom, shape (...,)


def without_seeds(y: Values) -> SeedFit:
    """Remove from the means of placements what a seed adds to all; estimate the noise of one value.

    Trainings of one seed share order, augmentation and initial weights. So a value is a part of its
    placement, one of its seed, and noise: a two-way analysis of variance without repetition (Fisher
    1925), by least squares where trainings are missing (Yates 1933). If all placements have the
    same seeds, the means are the plain ones. Where seeds cannot be compared, because placements do
    not share enough of them, these are `seed_mean` and `pooled_variance`.

    `y` has a row a placement and a column a seed, shape (..., n, seeds), NaN where one is missing.
    Leading axes are samples, each fitted by itself."""
    measured, means = np.isfinite(y), seed_mean(y)
    rest = np.where(measured, y - means[..., None], 0.0)
    counts = measured.sum(axis=-1, keepdims=True)
    shares = measured / np.maximum(counts, 1)  # of each seed in the mean of a placement
    # The normal equations of the seeds, after those of the placements are eliminated.
    each = np.eye(y.shape[-1]) * measured.sum(axis=-2)[..., None, :]
    matrix = each - np.swapaxes(measured, -1, -2).astype(np.float64) @ shares
    of_seeds = np.linalg.pinv(matrix, hermitian=True) @ rest.sum(axis=-2)[..., None]
    within = shares @ of_seeds
    squares = np.where(measured, rest + within - np.swapaxes(of_seeds, -1, -2), 0.0) ** 2
    free = measured.any(axis=-2).sum(axis=-1) - 1.0  # effects of seeds
    degrees = measured.sum(axis=(-2, -1)) - measured.any(axis=-1).sum(axis=-1) - free
    linked = (np.linalg.matrix_rank(matrix, hermitian=True) == free) & (degrees > 0)
    variance, unlinked = pooled_variance(y)
    return SeedFit(
        means - np.where(linked[..., None], within[..., 0], 0.0),
        np.where(linked, squares.sum(axis=(-2, -1)) / np.maximum(degrees, 1), variance),
        np.where(linked, degrees, unlinked),
    )


def _crossed(y: Values) -> NDArray[np.bool_]:
    """Tell whether two placements or more all have the same two seeds or more, shape (...,)."""
    return np.asarray(np.isfinite(y).all(axis=(-2, -1)) & (min(y.shape[-2:]) > 1))


def pooled_variance(y: Values) -> tuple[Values, NDArray[np.intp]]:
    """Pool the variance within placements over them; return it with its degrees of freedom."""
    counts = np.isfinite(y).sum(axis=-1)
    degrees = np.maximum(counts - 1, 0).sum(axis=-1)
    deviations = y - seed_mean(y)[..., None]
    total = np.nansum(deviations**2, axis=(-2, -1))
    return np.where(degrees > 0, total / np.maximum(degrees, 1), np.nan), degrees


def seed_mean(y: Values) -> Values:
    """Average over the seeds that are there, shape (..., n); NaN where none is."""
    counts = np.isfinite(y).sum(axis=-1)
    return np.where(counts > 0, np.nansum(y, axis=-1) / np.maximum(counts, 1), np.nan)


def reliability(
    means: Values, variance: ArrayLike, degrees: ArrayLike, confidence: float = 0.95
) -> Values:
    """Compute the share of the variance of means between placements that is not noise.

    1 - (variance of the noise of a mean) / (variance of the means). With `without_seeds` this is
    ICC(3, k) where all placements have the same seeds, ICC(1, k) for others in equal number (Shrout
    and Fleiss 1979). The interval is that of the F distribution, exact for normal means and
    noise. `means` have shape (..., n); `variance` and `degrees`, (...,), are of the noise of a
    mean: by seeds, test objects, or both.

    Value, lower and upper bound, shape (..., 3), in [0, 1]. NaN for fewer than two placements,
    noise without degrees of freedom, or no spread at all."""
    n, degrees = means.shape[-1], np.asarray(degrees, np.float64)
    spread = np.var(means, axis=-1, ddof=1) if n > 1 else np.zeros(means.shape[:-1])
    is_estimable = (degrees > 0) & (spread > 0)
    share = np.where(is_estimable, variance, np.nan) / np.where(is_estimable, spread, 1.0)
    tail = (1 + confidence) / 2
    freedom = np.where(is_estimable, degrees, np.nan)
    bounds = [stats.f.ppf(q, max(n - 1, 1), freedom) for q in (tail, 1 - tail)]
    within = share[..., None] * np.stack([np.ones_like(freedom), *bounds], -1)
    return np.asarray(np.clip(1 - within, 0, 1))


def reliability_of_mean(single: ArrayLike, seeds: ArrayLike) -> Values:
    """Compute the reliability of a mean over seeds from that of one (Spearman 1910, Brown 1910)."""
    one, s = np.asarray(single, np.float64), np.asarray(seeds, np.float64)
    return s * one / (1 + (s - 1) * one)

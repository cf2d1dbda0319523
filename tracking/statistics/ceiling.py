"""What a perfect predictor of a noisy metric would reach: the ceiling of a correlation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from tracking.statistics.confidence_interval import from_normal
from tracking.statistics.reliability import Noise


def reliability(
    means: NDArray[np.float64], noise: Noise, confidence: float = 0.95
) -> NDArray[np.float64]:
    """Share of the variance of means between placements that is not noise, with its interval.

    1 - (variance of the noise of a mean) / (variance of the means): for equal numbers of seeds the
    same as ICC(1, k), which Spearman and Brown's formula makes of ICC(1) (Shrout and Fleiss 1979).
    The interval is that of the F distribution, exact for normal means and noise.

    Args:
        means: shape (n,).
        noise: of seeds, of test objects, or of both.

    Returns:
        Value, lower and upper bound, shape (3,), in [0, 1]. NaN for fewer than two placements,
        noise without degrees of freedom, or no spread at all.
    """
    n = len(means)
    spread = float(np.var(means, ddof=1)) if n > 1 else 0.0
    if noise.degrees == 0 or spread == 0:
        return np.full(3, np.nan)
    share = noise.variance * float(np.mean(1 / noise.counts)) / spread
    tail = (1 + confidence) / 2
    bounds = stats.f.ppf([tail, 1 - tail], n - 1, noise.degrees)
    return np.clip(1 - share * np.concatenate([[1.0], bounds]), 0, 1)


def ceiling(reliable: ArrayLike, coefficient: str = "spearman") -> NDArray[np.float64]:
    """The coefficient of a metric of this reliability with what predicts it perfectly.

    Noise lowers a correlation by the root of the product of both reliabilities (attenuation,
    Spearman 1904), and a perfect predictor has neither noise nor error: sqrt(reliability), on the
    scale of a normal population's Pearson correlation, from where it becomes the coefficient's.
    It is what is expected: by luck a sample may exceed it.

    Args:
        reliable: in [0, 1], of any shape.

    Returns:
        The same shape, in [0, 1].
    """
    return np.asarray(from_normal(np.sqrt(np.asarray(reliable, np.float64)), coefficient))

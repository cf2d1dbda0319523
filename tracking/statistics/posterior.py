"""Draws of the placements' expected metrics, given their means and how these scatter."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tracking.statistics.reliability import Noise

DRAWS = 20_000
_BLOCK = 1_000
_LOG_RATIOS = np.linspace(-24.0, 40.0, 1281)
"""Of the variance between placements over that of a mean over seeds."""


def posterior(
    means: NDArray[np.float64], noise: Noise, seed: int = 0, draws: int = DRAWS
) -> Iterator[NDArray[np.float64]]:
    """Independent draws from the posterior of the expected metrics, block by block.

    Seeds scatter normally and alike. Expected metrics are normal around a common mean, so that a
    lead counts for less where the placements differ no more than their seeds do. The sd between
    placements, over that of a mean over seeds, has a half-Cauchy prior of scale 1 (Gelman 2006),
    which is proper with two placements too; common mean and logarithm of the noise have flat ones.
    Given that ratio the posterior has a closed form, so the draws are independent.

    Args:
        means: over seeds, shape (n,).
        noise: of seeds, or of the test objects as well, see `tracking.statistics.jackknife`; with
            degrees of freedom.
        seed: of the draws.

    Yields:
        Shape (draws of the block, n). Without any noise the means themselves, once.
    """
    n, counts, variance, degrees = len(means), noise.counts, noise.variance, noise.degrees
    if variance == 0:
        yield means[None]
        return
    rng = np.random.default_rng(seed)
    ratio = np.exp(_LOG_RATIOS)[:, None] * np.mean(1 / counts)  # between / within, shape (grid, 1)
    weight = 1 / (ratio + 1 / counts)
    centre = (weight * means).sum(axis=1) / weight.sum(axis=1)
    square = degrees * variance + (weight * (means - centre[:, None]) ** 2).sum(axis=1)
    freedom = degrees + n - 1
    log_density = (
        # The half-Cauchy density, of the logarithm of the ratio of variances.
        -0.5 * np.logaddexp(0, _LOG_RATIOS)
        - 0.5 * np.logaddexp(0, -_LOG_RATIOS)
        + 0.5 * np.log(weight).sum(axis=1)
        - 0.5 * np.log(weight.sum(axis=1))
        - 0.5 * freedom * np.log(square)
    )
    density = np.exp(log_density - log_density.max())
    done = 0
    while done < draws:
        size = min(_BLOCK, draws - done)
        at = rng.choice(len(ratio), size, p=density / density.sum())
        within = square[at] / rng.chisquare(freedom, size)
        common = centre[at] + np.sqrt(within / weight[at].sum(axis=1)) * rng.standard_normal(size)
        precision = counts + 1 / ratio[at]
        middle = (counts * means + common[:, None] / ratio[at]) / precision
        yield middle + np.sqrt(within[:, None] / precision) * rng.standard_normal((size, n))
        done += size

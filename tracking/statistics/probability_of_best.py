"""The probability of each placement to be the best, from the noise of the seeds and the spread."""

import numpy as np
from numpy.typing import NDArray

from tracking.statistics.posterior import DRAWS, posterior
from tracking.statistics.reliability import Noise


def probability_of_best(
    means: NDArray[np.float64], noise: Noise, seed: int = 0, draws: int = DRAWS
) -> NDArray[np.float64]:
    """Posterior probability of each placement to have the highest expected metric.

    Args:
        means, noise, seed, draws: see `tracking.statistics.posterior.posterior`.

    Returns:
        Shape (n,), sums to 1; equal placements share it where nothing is noise. NaN without
        degrees of freedom.
    """
    if noise.degrees == 0:
        return np.full(len(means), np.nan)
    wins = np.zeros(len(means))
    for drawn in posterior(means, noise, seed, draws):
        highest = drawn == drawn.max(axis=1, keepdims=True)
        wins += (highest / highest.sum(axis=1, keepdims=True)).sum(axis=0)
    return np.asarray(wins / wins.sum())

"""Posterior of the placements' expected metrics: draws, the best, and what a choice loses."""

from collections.abc import Iterator

import numpy as np

from tracking.statistics import Values
from tracking.statistics.reliability import Noise

DRAWS = 20_000
_BLOCK = 1_000
_LOG_RATIOS = np.linspace(-24.0, 40.0, 1281)
"""Logarithms of the variance between placements over that of a mean over seeds."""


def posterior(means: Values, noise: Noise, seed: int = 0, draws: int = DRAWS) -> Iterator[Values]:
    """Draw independently from the posterior of the expected metrics, block by block, (draws, n).

    Seeds scatter normally and alike. Expected metrics are normal around a common mean, so that a
    lead counts for less where the placements differ no more than their seeds do. The sd between
    placements, over that of a mean over seeds, has a half-Cauchy prior of scale 1 (Gelman 2006),
    which is proper with two placements too; common mean and logarithm of the noise have flat ones.
    Given that ratio the posterior has a closed form. Without any noise it is `means`, once. `noise`
    is of seeds, or of the test objects as well (`tracking.statistics.jackknife`), and has degrees
    of freedom."""
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
    drawn = 0
    while drawn < draws:
        size = min(_BLOCK, draws - drawn)
        at = rng.choice(len(ratio), size, p=density / density.sum())
        within = square[at] / rng.chisquare(freedom, size)
        common = centre[at] + np.sqrt(within / weight[at].sum(axis=1)) * rng.standard_normal(size)
        precision = counts + 1 / ratio[at]
        expected = (counts * means + common[:, None] / ratio[at]) / precision
        yield expected + np.sqrt(within[:, None] / precision) * rng.standard_normal((size, n))
        drawn += size


def probability_of_best(means: Values, noise: Noise, seed: int = 0, draws: int = DRAWS) -> Values:
    """Compute the posterior probability of each placement to have the highest metric, shape (n,).

    The metric is the expected one; arguments are those of `posterior`. Equal placements share it
    where nothing is noise; NaN without degrees of freedom."""
    if noise.degrees == 0:
        return np.full(len(means), np.nan)
    wins = np.zeros(len(means))
    for drawn in posterior(means, noise, seed, draws):
        highest = drawn == drawn.max(axis=1, keepdims=True)
        wins += (highest / highest.sum(axis=1, keepdims=True)).sum(axis=0)
    return np.asarray(wins / wins.sum())


def expected_regret(
    means: Values, noise: Noise, choices: Values, seed: int = 0, draws: int = DRAWS
) -> Values:
    """Compute how far the expected metric of a choice is below that of the truly best placement.

    The highest mean is partly the luckiest, so that the distance of a choice from it is too large
    on average. Here best and choice are those of expected metrics that are drawn from the
    posterior, which does not know by what was chosen: the expectation is rather too large for a
    choice that is better than the means suggest. `choices`: how likely each takes each placement,
    shape (choices, n), rows sum to 1; other arguments are those of `posterior`.

    Expected regret, in the unit of the means, and the bounds of its central 95 %, shape
    (choices, 3). NaN without degrees of freedom."""
    if noise.degrees == 0:
        return np.full((len(choices), 3), np.nan)
    blocks = posterior(means, noise, seed, draws)
    lost = np.concatenate([d.max(axis=1, keepdims=True) - d @ choices.T for d in blocks])
    return np.column_stack([lost.mean(axis=0), *np.quantile(lost, [0.025, 0.975], axis=0)])

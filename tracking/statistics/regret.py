"""What a choice among placements loses against the best of them."""

import numpy as np
from numpy.typing import NDArray

from tracking.statistics.posterior import DRAWS, posterior
from tracking.statistics.reliability import Noise


def expected_regret(
    means: NDArray[np.float64],
    noise: Noise,
    choices: NDArray[np.float64],
    seed: int = 0,
    draws: int = DRAWS,
) -> NDArray[np.float64]:
    """By how much the expected metric of a choice is below that of the truly best placement.

    The highest mean is partly the luckiest, so that the distance of a choice from it is too large
    on average, the more so the more placements there are. Here best and choice are those of
    expected metrics that are drawn from the posterior, with the whole noise. The posterior does not
    know by what was chosen, so that the expectation is rather too large for a choice that is
    better than the means tell.

    Args:
        means, noise, seed, draws: see `tracking.statistics.posterior.posterior`.
        choices: how likely each choice takes each placement, shape (choices, n), rows sum to 1: all
            on one placement, shared among equals, or the same for all for a choice at random.

    Returns:
        Expected regret, in the unit of the means, and the bounds of its central 95 %, shape
        (choices, 3). NaN without degrees of freedom.
    """
    if noise.degrees == 0:
        return np.full((len(choices), 3), np.nan)
    lost = np.concatenate(
        [
            drawn.max(axis=1, keepdims=True) - drawn @ choices.T
            for drawn in posterior(means, noise, seed, draws)
        ]
    )
    return np.column_stack([lost.mean(axis=0), *np.quantile(lost, [0.025, 0.975], axis=0)])

"""Variances that are estimated from few numbers each, moved towards what they have in common."""

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

MOST_DEGREES = 1e4
"""Of what the variances have in common: beyond, they are equal for every purpose."""


def moderated(variances: NDArray[np.float64], degrees: float) -> tuple[NDArray[np.float64], float]:
    """Posterior variances under a scaled inverse chi-square prior that is fitted to them.

    Empirical Bayes of Smyth (2004), section 6.2: the prior's degrees of freedom follow from how
    much the logarithms of the variances differ beyond chance. Equal variances are pooled; where
    they differ much each stays almost as it was estimated.

    Args:
        variances: shape (m,), not negative; zeros stay, and are in no fit.
        degrees: of each, more than 0.

    Returns:
        The variances, and their degrees of freedom: those given and those of the prior.
    """
    known = variances > 0
    if np.count_nonzero(known) < 2:
        return variances, degrees
    logs = np.log(variances[known])
    beyond = float(logs.var(ddof=1) - special.polygamma(1, degrees / 2))
    prior = min(2 * _inverse_trigamma(beyond), MOST_DEGREES) if beyond > 0 else MOST_DEGREES
    common = np.exp(logs.mean() - _bias(degrees) + _bias(prior))
    whole = prior + degrees
    return np.where(known, (prior * common + degrees * variances) / whole, 0.0), whole


def _bias(degrees: float) -> float:
    """Expectation of the logarithm of an estimate of a variance of 1."""
    return float(special.digamma(degrees / 2) - np.log(degrees / 2))


def _inverse_trigamma(value: float) -> float:
    """1 / x < trigamma(x) < 1 / x + 1 / x^2 brackets the root."""
    low, high = 1 / value, 1 / value + 1 / np.sqrt(value)
    return float(optimize.brentq(lambda x: special.polygamma(1, x) - value, low, high))

"""The studentized range, to 11 digits, in a fraction of the time of SciPy's adaptive integrals."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import ndtr

from tracking.statistics import Values

_FALL = 40.0
"""Nodes go on until a density has fallen to exp(-40) of its mode. Between such ends the trapezoidal
rule converges faster than any power of its step."""
_Z = np.arange(-8.8, 8.8, 0.15)
_DENSITY = 0.15 * np.exp(-0.5 * _Z**2) / math.sqrt(2.0 * math.pi)


def studentized_range_cdf(q: ArrayLike, groups: int, degrees: float) -> Values:
    """Probability that the range of so many standard normal values, divided by an estimate of
    their deviation with `degrees` degrees of freedom, which may be infinite, is at most `q`."""
    deviation, weight = _deviations(degrees)
    width = np.asarray(q, np.float64)[..., None, None] * deviation[:, None]
    within = ndtr(_Z) - ndtr(_Z - width)  # below the largest value, and less than the width
    found: Values = np.clip(groups * (within ** (groups - 1) @ _DENSITY) @ weight, 0.0, 1.0)
    return found


@lru_cache(maxsize=256)
def studentized_range_quantile(p: float, groups: int, degrees: float) -> float:
    """The `q` that `studentized_range_cdf` gives the probability `p`; degrees are 1 or more."""
    high = 8.0
    while studentized_range_cdf(high, groups, degrees) < p:
        high *= 2.0
    found = brentq(lambda q: float(studentized_range_cdf(q, groups, degrees)) - p, 0.0, high)
    return float(found)


def _deviations(degrees: float) -> tuple[Values, Values]:
    """Estimates of a deviation of 1, and how probable they are, in equal steps of the logarithm."""
    if math.isinf(degrees):
        return np.ones(1), np.ones(1)
    fall = _FALL / degrees
    low = fall + 0.5 if fall > 0.28 else math.sqrt(2.0 * fall)
    step = min(0.06, 0.35 / math.sqrt(degrees))
    log = np.arange(-low, min(2.5, math.sqrt(fall)), step)
    weight = np.exp(degrees * (log - 0.5 * np.expm1(2.0 * log)))
    return np.exp(log), weight / weight.sum()

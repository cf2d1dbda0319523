"""Power of tests: which correlation differs significantly from zero with so many placements."""

from bisect import bisect_left
from collections.abc import Sequence
from functools import lru_cache
from itertools import permutations

import numpy as np
import pandas as pd
from scipy import stats

from lidarplace.base.errors import InputError
from tracking.statistics import Values
from tracking.statistics.coefficients import LARGEST_EXACT, smallest_p

ALPHA = 0.05
TARGET = 0.8
MOST_PLACEMENTS = 10_000


@lru_cache(maxsize=4096)
def power(rho: float, n: int, coefficient: str = "pearson", reliability: float = 1.0) -> float:
    """Compute the probability that a two-sided test at 5 % finds a correlation.

    The population is normal. `pearson` is exact: given the surrogates, Student's t of r is not
    central. `spearman` is simulated from fixed draws (standard error below 0.013), with the exact
    critical value up to 8 placements. Up to 4 placements no permutation test reaches 5 %, so the
    power is 0. `reliability` is that of the mean over seeds, whose noise hides some of the
    correlation `rho`."""
    if not (-1 <= rho <= 1 and 0 <= reliability <= 1):
        wanted = "rho in [-1, 1] and reliability in [0, 1]"
        raise InputError(expected=wanted, found=f"{rho} and {reliability}")
    if coefficient not in ("pearson", "spearman"):
        wanted = "pearson or spearman"
        raise InputError(key="coefficient", expected=wanted, found=repr(coefficient))
    if n < 3 or smallest_p(n) > ALPHA:
        return 0.0
    if coefficient == "pearson":
        return _power_of_pearson(abs(rho) * np.sqrt(reliability), n)
    return _power_of_spearman(2 * np.sin(np.pi * abs(rho) / 6) * np.sqrt(reliability), n)


@lru_cache(maxsize=256)
def smallest_detectable(n: int, coefficient: str = "pearson", reliability: float = 1.0) -> float:
    """Find the smallest |rho| that n placements show with 80 % probability; NaN without any."""
    if power(1.0, n, coefficient, reliability) < TARGET:
        return float("nan")
    low, high = 0.0, 1.0
    while high - low > 1e-3:
        rho = (low + high) / 2
        if power(rho, n, coefficient, reliability) < TARGET:
            low = rho
        else:
            high = rho
    return high


def placements_needed(rho: float, coefficient: str = "pearson", reliability: float = 1.0) -> int:
    """Find how many placements find a correlation of `rho` with 80 % probability.

    Raises ValueError: 10,000 do not suffice."""
    if power(rho, MOST_PLACEMENTS, coefficient, reliability) < TARGET:
        raise InputError(f"{MOST_PLACEMENTS} placements do not suffice to find rho = {rho:g}")
    sizes = range(5, MOST_PLACEMENTS + 1)
    index = bisect_left(sizes, TARGET, key=lambda n: power(rho, n, coefficient, reliability))
    return sizes[index]


def power_table(placements: Sequence[int], reliability: float = 1.0) -> pd.DataFrame:
    """Compute `smallest_detectable` by number of placements: columns n, pearson, spearman."""
    columns = {
        name: [smallest_detectable(n, name, reliability) for n in placements]
        for name in ("pearson", "spearman")
    }
    return pd.DataFrame({"n": list(placements), **columns})


def _power_of_pearson(rho: float, n: int) -> float:
    """Compute the power exactly: given x, t of r is noncentral.

    Its noncentrality is rho / sqrt(1 - rho^2) times a chi of n - 1 degrees."""
    if rho > 1 - 1e-9:
        return 1.0
    nodes, weights = np.polynomial.legendre.leggauss(32)
    shift = rho**2 / (1 - rho**2) * stats.chi2.ppf((nodes + 1) / 2, n - 1)
    shift = np.maximum(shift, 1e-9)  # at 0 itself scipy's ncf.sf is wrong (1.17)
    critical = stats.t.ppf(1 - ALPHA / 2, n - 2)
    # Both tails of t are one tail of F.
    return float(weights / 2 @ stats.ncf.sf(critical**2, 1, n - 2, shift))


def _power_of_spearman(rho: float, n: int) -> float:
    """Compute the share of simulated samples whose |rho| reaches the critical value."""
    x, noise = _samples(n)
    y = rho * x + np.sqrt(max(1 - rho**2, 0.0)) * noise
    ranks = np.arange(n) - (n - 1) / 2
    coefficients = np.argsort(y, axis=1) @ ranks / (ranks @ ranks)
    return float(np.mean(np.abs(coefficients) >= _critical_spearman(n) - 1e-9))


@lru_cache(maxsize=1)  # a bisection over rho has one n
def _samples(n: int) -> tuple[Values, Values]:
    """Draw two independent samples of n in each draw, shape (draws, n).

    The first one is in its order: it has the ranks 0 to n - 1."""
    draws = int(np.clip(100_000 // n, 1_000, 10_000))
    rng = np.random.default_rng(0)
    return np.sort(rng.standard_normal((draws, n)), axis=1), rng.standard_normal((draws, n))


@lru_cache(maxsize=256)
def _critical_spearman(n: int) -> float:
    """Return the smallest |rho| with a two-sided p of 5 %; by Student's t beyond 8 placements."""
    if n > LARGEST_EXACT:
        t = stats.t.ppf(1 - ALPHA / 2, n - 2)
        return float(t / np.sqrt(n - 2 + t**2))
    orders = np.array(list(permutations(range(n))), dtype=np.float64)
    ranks = np.arange(n) - (n - 1) / 2
    null = np.sort(np.round(orders @ ranks / (ranks @ ranks), 12))
    # Equal values at the edge would take the tail above its share: then it is the next larger one.
    return float(np.min(null[null > null[-int(ALPHA / 2 * len(null)) - 1]]))

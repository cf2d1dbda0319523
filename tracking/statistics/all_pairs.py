"""Differences between all pairs of placements, in intervals that hold for all of them at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import stats

from tracking.statistics import Values
from tracking.statistics.jackknife import SampleError
from tracking.statistics.reliability import Noise

_DEGREES = (*range(1, 13), 15, 20, 24, 30, 40, 60, 120, 1000)
"""Degrees of freedom with critical values, as in printed tables: each takes 0.2 s.

Others use the next lower number."""


@dataclass(frozen=True, eq=False)
class AllPairs:
    """Means of placements, and how their differences scatter."""

    means: Values  # shape (n,)
    variance: Values  # of the difference of two means, shape (n, n)
    degrees: Values  # its degrees of freedom, shape (n, n); 0 where it is unknown

    @classmethod
    def of(
        cls, means: Values, noise: Noise, sample: SampleError | None = None, alone: bool = False
    ) -> AllPairs:
        """Add variances by seeds and by test objects; degrees of freedom are Satterthwaite's.

        `noise` is that of the seeds, `Noise.of`, alike for all placements; `sample` is of the same
        placements in the same order. `alone`: whether the test objects alone count where the seeds'
        noise is unknown."""
        of_seeds = noise.variance * np.add.outer(1 / noise.counts, 1 / noise.counts)
        degrees = np.full(of_seeds.shape, float(noise.degrees))
        if sample is None or not (noise.degrees or alone):
            return cls(means, of_seeds, degrees)
        of_objects, degrees_of_objects = sample.of_pairs()
        if not noise.degrees:
            return cls(means, of_objects, np.full(of_seeds.shape, degrees_of_objects))
        whole = of_seeds + of_objects
        parts = of_seeds**2 / degrees + of_objects**2 / degrees_of_objects
        return cls(means, whole, np.divide(whole**2, parts, out=degrees, where=parts > 0))

    def intervals(self, at: int) -> Values:
        """Compute 95 % intervals of one placement's leads, for all pairs at once, shape (n, 2).

        By the studentized range: Tukey and Kramer's where all pairs scatter alike, else as of Games
        and Howell (1976). NaN for one placement and without degrees of freedom."""
        n = len(self.means)
        degrees, index = np.unique(self.degrees[at], return_inverse=True)
        critical = np.array([_critical_range(n, float(one)) for one in degrees])
        half = critical[index] * np.sqrt(self.variance[at] / 2)
        lead = self.means[at] - self.means
        return np.stack([lead - half, lead + half], axis=1)

    def p_of_no_lead(self, at: int) -> Values:
        """Compute p of no difference to each placement, adjusted as `intervals`, shape (n,)."""
        n, degrees = len(self.means), self.degrees[at]
        if n < 2 or not degrees.all():
            return np.full(n, np.nan)
        lead, error = np.abs(self.means[at] - self.means), np.sqrt(self.variance[at] / 2)
        # Without any spread every lead is certain, and no lead is none.
        ratio = np.where(lead > 0, np.inf, 0.0)
        ratio = np.divide(lead, error, out=ratio, where=error > 0)
        p = stats.studentized_range.sf(ratio, n, degrees)
        return np.where(np.isinf(ratio), 0.0, p)


def _critical_range(placements: int, degrees: float) -> float:
    """Return the studentized range that 5 % of samples exceed; NaN where there is none."""
    if placements < 2 or not degrees >= 1:
        return math.nan
    if placements == 2:  # the same in closed form
        return math.sqrt(2) * float(stats.t.ppf(0.975, degrees))
    return _tabulated(placements, max(one for one in _DEGREES if one <= degrees))


@lru_cache(maxsize=256)
def _tabulated(placements: int, degrees: int) -> float:
    return float(stats.studentized_range.ppf(0.95, placements, degrees))


def pair_agreement(values: Values, pairs: AllPairs) -> tuple[float, int]:
    """Compute the share of pairs that a predictor orders as their means, and their number.

    Those count of which the 95 % interval of their own difference, by Student's distribution,
    leaves out zero. Where the predictor gives both the same value it is right by half. `values` are
    in the order of `pairs`, high for good ones, shape (n,)."""
    one, two = np.triu_indices(len(values), 1)
    lead = (pairs.means[one] - pairs.means[two]).astype(np.float64)
    degrees = pairs.degrees[one, two]
    has_degrees = degrees > 0
    reach = stats.t.ppf(0.975, np.where(has_degrees, degrees, 1.0))
    differ = has_degrees & (np.abs(lead) > reach * np.sqrt(pairs.variance[one, two]))
    if not differ.any():
        return float("nan"), 0
    agree = np.sign(values[one] - values[two]) * np.sign(lead)
    return float((1 + agree[differ]).mean() / 2), int(differ.sum())

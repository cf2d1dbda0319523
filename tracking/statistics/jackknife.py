"""Error of AP and recall by the choice of test routes and individuals.

The test frames are one draw of the traffic. Their error is estimated by leaving each route out in
turn, and each individual (the delete-one jackknife, with Student's distribution as for few
clusters: MacKinnon, Nielsen and Webb 2023). Routes hold what their objects share, but are few;
individuals are more, but are taken as independent: the larger of the two errors counts. Units are
left out of the area that AP_R40 samples (`training.leave_out`), which moves smoothly with them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import optimize, special

from tracking.statistics import Values
from tracking.statistics.reliability import Noise

NOTHING = "nothing"
"""Unit of the values with nothing left out: those that the others are compared with."""
LEAST_ROUTES = 4
"""Least number of routes with objects of the class; fewer do not show how routes differ.

Then individuals alone count."""
LEAST_OWN_UNITS = 11
"""Effective units, less one, from which on every pair of placements has a variance of its own.

With fewer, intervals of all pairs at once cover less than those of a pooled one
(docs/statistics.md)."""


@dataclass(frozen=True, eq=False)
class SampleError:
    """Error of a mean over seeds by the choice of the test routes and individuals."""

    variance: float  # of one mean, the mean over the placements
    degrees: float  # its degrees of freedom
    unit: str  # what was left out, "route" or "individual"
    units: float  # how many equal ones have as much of the ground truth, less one
    # of the placements' means, or if paired of their deviations from the mean over placements; both
    # index and columns are the placements
    covariance: pd.DataFrame

    def among(self, placements: Sequence[str]) -> SampleError:
        """Select the `covariance` of these placements, in this order."""
        order = pd.Index(placements)
        return replace(self, covariance=self.covariance.reindex(index=order, columns=order))

    def of_pairs(self) -> tuple[Values, float]:
        """Compute variance, shape (n, n), and degrees of freedom of differences of two means.

        Each pair has a variance of its own, `moderated` by those of the others; of fewer than
        `LEAST_OWN_UNITS` units all have the pooled one."""
        matrix = self.covariance.to_numpy(np.float64)
        n = len(matrix)
        if self.units < LEAST_OWN_UNITS or not np.isfinite(matrix).all():
            return np.where(np.eye(n), 0.0, 2 * self.variance), self.degrees
        unpooled = np.add.outer(np.diag(matrix), np.diag(matrix)) - 2 * matrix
        pair = np.triu_indices(n, 1)
        values, degrees = moderated(np.maximum(unpooled[pair], 0.0), self.units)
        pair_variances = np.zeros((n, n))
        pair_variances[pair] = values
        return pair_variances + pair_variances.T, degrees


def sample_error(left_out: pd.DataFrame, paired: bool) -> SampleError | None:
    """Estimate the error of placements that were tested on the same frames.

    Degrees of freedom are Satterthwaite's: units count by their shares of the ground truth, and
    paired placements by how alike their deviations are. `left_out` has rows of one class, detector,
    setting, metric and IoU: placement, seed, unit, left_out, ground_truths, value. `paired`: of a
    placement against the others; what a unit does to all of them cancels, and the difference of two
    placements has twice the variance.

    None where it cannot be known: fewer than two units, one that has all ground truths, or, if
    paired, a single placement."""
    return largest(error_of_units(*unit, paired) for unit in by_unit(left_out))


def largest(errors: Iterable[SampleError | None]) -> SampleError | None:
    """Return the error with the larger variance; None without any."""
    return max(filter(None, errors), key=lambda error: error.variance, default=None)


def by_unit(left_out: pd.DataFrame) -> Iterator[tuple[Values, Values, pd.Index[str], str]]:
    """Yield the arguments of `error_of_units` for each unit in `left_out`."""
    each = left_out[left_out["unit"].isin(["route", "individual"])]
    for unit, rows in each.groupby("unit"):
        counts = rows.groupby("left_out")["ground_truths"].first().to_numpy(np.float64)
        values = rows.groupby(["left_out", "placement"])["value"].mean().unstack()
        yield values.to_numpy(np.float64), counts, values.columns, str(unit)


def effective(counts: Values, members: Values | float = 1.0) -> float:
    """Count the units of equal size that weigh as much, (Σn)² / Σn² of units of n boxes.

    `members`: the same of the units that each one groups. inf without any box."""
    squares = float((counts**2 / members).sum())
    return float(counts.sum()) ** 2 / squares if squares else math.inf


def effective_individuals(left_out: pd.DataFrame) -> float:
    """Count the `effective` individuals in rows of one class, metric and IoU."""
    rows = left_out[left_out["unit"] == "individual"].drop_duplicates("left_out")
    # `members` is optional in a table that is made in Python; reading a run folder adds it.
    members = rows["members"].to_numpy(np.float64) if "members" in rows else 1.0
    return effective(rows["ground_truths"].to_numpy(np.float64), members)


def error_of_units(
    values: Values, counts: Values, names: pd.Index[str], unit: str, paired: bool
) -> SampleError | None:
    """Estimate `sample_error` of one unit, "route" or "individual", from arrays.

    `values` are means over seeds with each unit left out (a row) of each placement (a column, by
    `names`); `counts` are the ground truths of each unit."""
    placements, units = values.shape[1], int(np.count_nonzero(counts))
    enough = units >= (LEAST_ROUTES if unit == "route" else 2) and placements > paired
    if not enough or np.isnan(values).any():
        return None
    if paired:
        values = values - values.mean(axis=1, keepdims=True)
    covariance = np.zeros((placements, placements))
    alarms = (counts == 0) & (unit == "individual")
    for stratum in (values[~alarms], values[alarms]):
        if len(stratum):
            deviations = stratum - stratum.mean(axis=0)
            covariance += (1 - 1 / len(stratum)) * (deviations.T @ deviations)
    total = float(np.trace(covariance))
    degrees = equal_units = max(effective(counts) - 1, 1.0)
    if paired and total > 0:
        degrees *= max(total**2 / float((covariance**2).sum()), 1.0)
    of_placements = pd.DataFrame(covariance, names, names)
    return SampleError(total / (placements - paired), degrees, unit, equal_units, of_placements)


def combined(noise: Noise, error: SampleError | None) -> Noise:
    """Combine seeds and test objects to one noise: that of seeds alone that would scatter as much.

    Degrees of freedom are rounded down. Without any it stays as it is."""
    if error is None or error.variance == 0 or noise.degrees == 0:
        return noise
    counts, variance = noise.counts, noise.variance
    seeds = len(counts) / (1 / counts).sum()
    other = error.variance * seeds
    whole = variance + other
    freedom = whole**2 / (variance**2 / noise.degrees + other**2 / error.degrees)
    alone = whole / (variance / counts + error.variance)
    return Noise(alone, whole, math.floor(max(freedom, 1.0)), noise.seed_sd)


MOST_DEGREES = 1e4  # of what the variances have in common: beyond, they are equal for every purpose


def moderated(variances: Values, degrees: float) -> tuple[Values, float]:
    """Compute posterior variances under a scaled inverse chi-square prior that is fitted to them.

    Empirical Bayes of Smyth (2004), section 6.2: the prior's degrees of freedom follow from how
    much the logarithms of the variances differ beyond chance. Equal variances are pooled; where
    they differ much each stays almost as it was estimated. `variances` have shape (m,), are not
    negative, and zeros stay; `degrees`, above 0, are those of each. Returns those of the prior
    added."""
    is_positive = variances > 0
    if np.count_nonzero(is_positive) < 2:
        return variances, degrees
    logs = np.log(variances[is_positive])
    beyond = float(logs.var(ddof=1) - special.polygamma(1, degrees / 2))
    prior = min(2 * _inverse_trigamma(beyond), MOST_DEGREES) if beyond > 0 else MOST_DEGREES
    common = np.exp(logs.mean() - _bias(degrees) + _bias(prior))
    whole = prior + degrees
    return np.where(is_positive, (prior * common + degrees * variances) / whole, 0.0), whole


def _bias(degrees: float) -> float:
    """Return the expectation of the logarithm of an estimate of a variance of 1."""
    return float(special.digamma(degrees / 2) - np.log(degrees / 2))


def _inverse_trigamma(value: float) -> float:
    """Find the root, which 1 / x < trigamma(x) < 1 / x + 1 / x^2 brackets."""
    low, high = 1 / value, 1 / value + 1 / np.sqrt(value)
    return float(optimize.brentq(lambda x: special.polygamma(1, x) - value, low, high))

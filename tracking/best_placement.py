"""Which placement is best, by how much, and how sure is that?"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from tracking.reliability import pooled_variance, seed_mean

_DRAWS = 20_000
_BLOCK = 1_000


@dataclass(frozen=True)
class BestPlacement:
    """The placement of the highest mean over seeds, and the others behind it.

    Attributes:
        best: its name.
        mean: its mean, in the unit of the metric.
        others: index placement, best mean first: `mean`; `seeds`; `lead` of the best over it; `low`
            and `high`, 95 % intervals of all leads at once; `p` of no difference, adjusted alike.
        sure: index placement, best mean first: the probability that its expected metric is the
            highest, given the results and a flat prior.
        sd: over seeds within placements, pooled.
        note: why there are no intervals, or "".
    """

    best: str
    mean: float
    others: pd.DataFrame
    sure: pd.Series
    sd: float
    note: str

    @property
    def equal(self) -> list[str]:
        """The best and those with the same mean."""
        return [self.best, *map(str, self.others.index[self.others["lead"] == 0])]

    @property
    def tied(self) -> list[str]:
        """Others that cannot be told from the best: the interval of the lead does not exceed 0."""
        return [str(name) for name in self.others.index[~(self.others["low"] > 0)]]


def best_placement(results: pd.DataFrame, seed: int = 0) -> BestPlacement | None:
    """Compare all placements with the best.

    The best is chosen from the same results. So its leads have the intervals of Tukey and Kramer,
    which hold for all pairs of placements at once, whichever is chosen afterwards. Seeds are taken
    to scatter alike under all placements, and normally.

    Args:
        results: placement, seed, value: rows of one class, detector, setting, metric, IoU and
            difficulty. NaN where a training failed or there was no ground truth.
        seed: of the draws from the posterior.

    Returns:
        None if there is no value. NaN for all that needs the spread over seeds if no placement has
        two.

    Raises:
        ValueError: a placement has two values for a seed.
    """
    known = results[results["value"].notna()]
    if known.empty:
        return None
    twice = known[known.duplicated(["placement", "seed"])]
    if len(twice):
        placement, number = twice.iloc[0][["placement", "seed"]]
        raise ValueError(f"placement {placement!r} has two values for seed {number}")
    y = known.pivot(index="placement", columns="seed", values="value")
    y = y.reindex(known["placement"].unique())
    y = y.iloc[np.argsort(-seed_mean(y.to_numpy(np.float64)), kind="stable")]
    values = y.to_numpy(np.float64)
    means, counts = seed_mean(values), np.isfinite(values).sum(axis=1)
    pooled, extra = pooled_variance(values)
    variance, degrees = float(pooled), int(extra)
    low, high, p = _leads(means, counts, variance, degrees)
    table = {"mean": means, "seeds": counts, "lead": means[0] - means}
    others = pd.DataFrame({**table, "low": low, "high": high, "p": p}, index=y.index)
    note = ""
    if len(y) == 1:
        note = "one placement: there is nothing to compare it with"
    elif degrees == 0:
        note = "one seed each: how much the training scatters is unknown, so there is no interval"
    return BestPlacement(
        best=str(y.index[0]),
        mean=float(means[0]),
        others=others.iloc[1:],
        sure=pd.Series(_posterior(means, counts, variance, degrees, seed), y.index, name="sure"),
        sd=float(np.sqrt(variance)),
        note=note,
    )


def _leads(
    means: NDArray[np.float64], counts: NDArray[np.intp], variance: float, degrees: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Low, high and p of the lead of the first over each, by the studentized range."""
    unknown = np.full(len(means), np.nan)
    if degrees == 0 or len(means) < 2:
        return unknown, unknown, unknown
    lead = means[0] - means
    error = np.sqrt(variance / 2 * (1 / counts[0] + 1 / counts))
    half = _critical_range(len(means), degrees) * error
    # Without any spread over seeds every lead is certain, and no lead is none.
    ratio = np.where(lead > 0, np.inf, 0.0)
    ratio = np.divide(lead, error, out=ratio, where=error > 0)
    return (
        lead - half,
        lead + half,
        np.where(np.isinf(ratio), 0.0, stats.studentized_range.sf(ratio, len(means), degrees)),
    )


@lru_cache(maxsize=256)
def _critical_range(placements: int, degrees: int) -> float:
    """What 5 % of studentized ranges exceed; slow to compute, and the same for every metric."""
    return float(stats.studentized_range.ppf(0.95, placements, degrees))


def _posterior(
    means: NDArray[np.float64],
    counts: NDArray[np.intp],
    variance: float,
    degrees: int,
    seed: int,
) -> NDArray[np.float64]:
    """Probability of each placement to have the highest expectation: normal, flat prior."""
    if degrees == 0:
        return np.full(len(means), np.nan)
    rng = np.random.default_rng(seed)
    wins = np.zeros(len(means))
    for _ in range(_DRAWS // _BLOCK):
        sd = np.sqrt(degrees * variance / rng.chisquare(degrees, (_BLOCK, 1)))
        drawn = means + sd * rng.standard_normal((_BLOCK, len(means))) / np.sqrt(counts)
        highest = drawn == drawn.max(axis=1, keepdims=True)  # several where nothing scatters
        wins += (highest / highest.sum(axis=1, keepdims=True)).sum(axis=0)
    return wins / _DRAWS

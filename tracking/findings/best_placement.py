"""Which placement is best, by how much, and how sure is that?"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from tracking.statistics.jackknife import SampleError, combined, sample_error
from tracking.statistics.probability_of_best import probability_of_best
from tracking.statistics.reliability import Noise, seed_mean


@dataclass(frozen=True)
class BestPlacement:
    """The placement of the highest mean over seeds, and the others behind it.

    Attributes:
        best: its name.
        mean: its mean, in the unit of the metric.
        others: index placement, best mean first: `mean`; `seeds`; `lead` of the best over it; `low`
            and `high`, 95 % intervals of all leads at once; `p` of no difference, adjusted alike.
        sure: index placement, best mean first: the probability that its expected metric is the
            highest (`tracking.statistics.probability_of_best`).
        sd: over seeds within placements, pooled.
        sample: error of a placement against the others by the choice of the test objects; None
            where it is unknown, and intervals and probabilities are over seeds alone.
        note: why there are no intervals, or "".
        noise: of the means over seeds and test objects, the best first.
    """

    best: str
    mean: float
    others: pd.DataFrame
    sure: pd.Series
    sd: float
    sample: SampleError | None
    note: str
    noise: Noise

    def differences(self, reference: str) -> pd.DataFrame:
        """All placements against one of them, in intervals that hold for all pairs at once.

        Returns:
            Index placement, best mean first: `difference` to `reference`, `low` and `high`.

        Raises:
            KeyError: `reference` has no value.
        """
        names, means = self.sure.index, self.means
        at = names.get_loc(reference)
        order = np.array([at, *np.delete(np.arange(len(names)), at)])
        noise = replace(self.noise, counts=self.noise.counts[order])
        intervals = lead_intervals(means[order], noise)
        table = {"difference": means[order] - means[at], "low": -intervals[:, 1]}
        return pd.DataFrame(table | {"high": -intervals[:, 0]}, names[order]).loc[names]

    @property
    def means(self) -> NDArray[np.float64]:
        """Of all placements, the best first, shape (n,)."""
        return np.concatenate([[self.mean], self.others["mean"].to_numpy(np.float64)])

    @property
    def equal(self) -> list[str]:
        """The best and those with the same mean."""
        return [self.best, *map(str, self.others.index[self.others["lead"] == 0])]

    @property
    def tied(self) -> list[str]:
        """Others that cannot be told from the best: the interval of the lead does not exceed 0."""
        return [str(name) for name in self.others.index[~(self.others["low"] > 0)]]


def best_placement(
    results: pd.DataFrame,
    seed: int = 0,
    left_out: pd.DataFrame | None = None,
    generalist: bool = False,
) -> BestPlacement | None:
    """Compare all placements with the best.

    The best is chosen from the same results. So its leads have the intervals of Tukey and Kramer,
    which hold for all pairs of placements at once, whichever is chosen afterwards. Seeds are taken
    to scatter alike under all placements, and normally; other test objects to shift any placement
    against the others alike.

    Args:
        results: placement, seed, value: rows of one class, detector, setting, metric, IoU and
            difficulty. NaN where a training failed or there was no ground truth.
        seed: of the draws from the posterior.
        left_out: the same without each unit of the test objects, see
            `tracking.statistics.jackknife.sample_error`.
        generalist: whether a seed is a detector that has judged all placements. What it gives to
            all of them alike is no scatter between them. With one of them the error of the test
            objects is what is left; what another generalist would say is not in it.

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
    means = seed_mean(values)
    of_seeds = Noise.of(values, shared=generalist)
    sample = None if left_out is None else sample_error(left_out, paired=True)
    noise = noise_of(values, sample, generalist)
    low, high = lead_intervals(means, noise).T
    table = {"mean": means, "seeds": of_seeds.counts, "lead": means[0] - means}
    table |= {"low": low, "high": high, "p": _lead_tests(means, noise)}
    others = pd.DataFrame(table, index=y.index)
    note = ""
    if len(y) == 1:
        note = "one placement: there is nothing to compare it with"
    elif of_seeds.degrees == 0 and noise.degrees > 0:
        note = "one generalist: what another one would say is not in the intervals"
    elif of_seeds.degrees == 0:
        note = "one seed each: how much the training scatters is unknown, so there is no interval"
    return BestPlacement(
        best=str(y.index[0]),
        mean=float(means[0]),
        others=others.iloc[1:],
        sure=pd.Series(probability_of_best(means, noise, seed), y.index, name="sure"),
        sd=float(np.sqrt(of_seeds.variance)),
        sample=sample,
        note=note,
        noise=noise,
    )


def noise_of(values: NDArray[np.float64], sample: SampleError | None, generalist: bool) -> Noise:
    """How means over seeds scatter by seeds and test objects.

    Args:
        values: of placements by seeds, NaN where a seed is missing, shape (n, seeds).
        sample: error by the choice of the test objects, where it is known.
        generalist: as for `best_placement`.
    """
    of_seeds = Noise.of(values, shared=generalist)
    if generalist and of_seeds.degrees == 0 and sample is not None and len(values) > 1:
        return Noise(of_seeds.counts, sample.variance, math.floor(sample.degrees))
    return combined(of_seeds, sample)


def lead_intervals(means: NDArray[np.float64], noise: Noise) -> NDArray[np.float64]:
    """95 % intervals of the lead of the first over each, for all pairs at once, shape (n, 2).

    Tukey and Kramer's, by the studentized range. NaN for one placement and without degrees of
    freedom.
    """
    if noise.degrees == 0 or len(means) < 2:
        return np.full((len(means), 2), np.nan)
    half = _critical_range(len(means), noise.degrees) * _error(noise)
    lead = means[0] - means
    return np.stack([lead - half, lead + half], axis=1)


def _lead_tests(means: NDArray[np.float64], noise: Noise) -> NDArray[np.float64]:
    """p of no lead of the first over each, adjusted as `lead_intervals`, shape (n,)."""
    if noise.degrees == 0 or len(means) < 2:
        return np.full(len(means), np.nan)
    lead, error = means[0] - means, _error(noise)
    # Without any spread over seeds every lead is certain, and no lead is none.
    ratio = np.where(lead > 0, np.inf, 0.0)
    ratio = np.divide(lead, error, out=ratio, where=error > 0)
    p = stats.studentized_range.sf(ratio, len(means), noise.degrees)
    return np.where(np.isinf(ratio), 0.0, p)


def _error(noise: Noise) -> NDArray[np.float64]:
    """Standard error of the lead of the first over each, by the root of 2."""
    return np.sqrt(noise.variance / 2 * (1 / noise.counts[0] + 1 / noise.counts))


@lru_cache(maxsize=256)
def _critical_range(placements: int, degrees: float) -> float:
    """What 5 % of studentized ranges exceed; slow to compute, and the same for every metric."""
    if placements == 2:  # the same in closed form
        return math.sqrt(2) * float(stats.t.ppf(0.975, degrees))
    return float(stats.studentized_range.ppf(0.95, placements, degrees))

"""Comparison of all placements with the best: leads, intervals and probabilities."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tracking.statistics.all_pairs import AllPairs
from tracking.statistics.jackknife import NOTHING, SampleError, combined, sample_error
from tracking.statistics.posterior import probability_of_best
from tracking.statistics.reliability import Noise, seed_mean


@dataclass(frozen=True)
class BestPlacement:
    """The placement of the highest mean over seeds, and the others behind it.

    Attributes:
        others: index placement, best mean first: `mean`; `seeds`; `lead` of the best over it; `low`
            and `high`, 95 % intervals of all leads at once.
        sure: index placement, best mean first: how likely its expected metric is the highest.
        sd: of one seed's value, as far as it changes differences between placements.
        seed_sd: of what a seed adds to all placements alike; NaN where they have different seeds.
        sample: error of a placement against the others by the choice of the test objects; None
            where it is unknown, and intervals and probabilities are over seeds alone.
        note: why there are no intervals, or "".
        noise, pairs: of the means over seeds and test objects, and of their differences; the best
            first."""

    best: str
    mean: float
    others: pd.DataFrame
    sure: pd.Series
    sd: float
    seed_sd: float
    sample: SampleError | None
    note: str
    noise: Noise
    pairs: AllPairs

    def differences(self, reference: str) -> pd.DataFrame:
        """Compare all placements with one of them, in intervals that hold for all pairs at once.

        Index placement, best first: `difference`, `low`, `high`. Raises KeyError: no value."""
        if reference not in self.sure.index:
            raise KeyError(reference)
        at = self.sure.index.tolist().index(reference)
        intervals = -self.pairs.intervals(at)[:, ::-1]
        table = {"difference": self.means - self.means[at]}
        table |= {"low": intervals[:, 0], "high": intervals[:, 1]}
        return pd.DataFrame(table, self.sure.index)

    @property
    def means(self) -> NDArray[np.float64]:
        """Compared values of all placements, the best first, shape (n,): of AP the area."""
        return self.pairs.means

    @property
    def p(self) -> pd.Series:
        """p-values of no difference of the best to each other one, adjusted as the intervals."""
        return pd.Series(self.pairs.p_of_no_lead(0)[1:], self.others.index)

    @property
    def equal(self) -> list[str]:
        """Best placement, and those with the same mean."""
        return [self.best, *map(str, self.others.index[self.others["lead"] == 0])]

    @property
    def tied(self) -> list[str]:
        """Others not significantly behind the best: the lead's interval does not exceed 0."""
        return [str(name) for name in self.others.index[~(self.others["low"] > 0)]]


def best_placement(
    results: pd.DataFrame, left_out: pd.DataFrame | None = None, generalist: bool = False
) -> BestPlacement | None:
    """Compare all placements with the best, in intervals that hold for all pairs of them at once.

    Seeds are taken to scatter alike under all placements; the same seeds are paired. AP is compared
    as the area under precision over recall where `left_out` has it: AP_R40 samples that area, and
    its steps differ between placements by up to a point or two.

    `results` are rows of one class, detector, setting, metric, IoU and difficulty: placement, seed
    and value, NaN where a training failed or there was no ground truth; `left_out` the same without
    each unit of the test objects (`tracking.statistics.jackknife.sample_error`). `generalist`: a
    seed is a detector that has judged all placements; with one of them the error of the test
    objects is what is left.

    None if there is no value; NaN for all that needs the spread over seeds if no placement has two.
    Raises ValueError: a placement has two values for a seed."""
    tested = results[results["value"].notna()]
    if tested.empty:
        return None
    twice = tested[tested.duplicated(["placement", "seed"])]
    if len(twice):
        placement, number = twice.iloc[0][["placement", "seed"]]
        raise ValueError(f"placement {placement!r} has two values for seed {number}")
    y = tested.pivot(index="placement", columns="seed", values="value")
    area = _as_area(y.reindex(tested["placement"].unique()), left_out)
    area = area.iloc[np.argsort(-seed_mean(area.to_numpy(np.float64)), kind="stable")]
    y = y.reindex(area.index)
    values = area.to_numpy(np.float64)
    means, reported_means = seed_mean(values), seed_mean(y.to_numpy(np.float64))
    of_seeds = Noise.of(values)
    sample = None if left_out is None else sample_error(left_out, paired=True)
    ordered = None if sample is None else sample.among([*y.index])
    noise = combined(of_seeds, sample)
    if generalist and of_seeds.degrees == 0 and sample is not None and len(y) > 1:
        noise = Noise(of_seeds.counts, sample.variance, math.floor(sample.degrees))
    pairs = AllPairs.of(means, of_seeds, ordered, alone=generalist)
    low, high = pairs.intervals(0).T
    table = {"mean": reported_means, "seeds": of_seeds.counts, "lead": means[0] - means}
    table |= {"low": low, "high": high}
    others = pd.DataFrame(table, index=y.index)
    return BestPlacement(
        best=str(y.index[0]),
        mean=float(reported_means[0]),
        others=others.iloc[1:],
        sure=pd.Series(probability_of_best(means, noise), y.index, name="sure"),
        sd=float(np.sqrt(of_seeds.variance)),
        seed_sd=of_seeds.seed_sd,
        sample=sample,
        note=_note(len(y), of_seeds, noise),
        noise=noise,
        pairs=pairs,
    )


def _note(placements: int, of_seeds: Noise, noise: Noise) -> str:
    """Say why there are no intervals, or what is not in them; "" if all is."""
    if placements == 1:
        return "one placement: there is nothing to compare it with"
    if of_seeds.degrees > 0:
        return ""
    if noise.degrees > 0:
        return "one generalist: intervals do not include the spread over generalists"
    return "one seed each: the training noise is unknown, so there is no interval"


def _as_area(y: pd.DataFrame, left_out: pd.DataFrame | None) -> pd.DataFrame:
    """Take the values of `y` with nothing left out, if the table has all of them."""
    if left_out is None:
        return y
    whole = left_out[left_out["unit"] == NOTHING]
    area = whole.pivot(index="placement", columns="seed", values="value")
    area = area.reindex(index=y.index, columns=y.columns).where(y.notna())
    return area if (area.notna() == y.notna()).to_numpy().all() else y

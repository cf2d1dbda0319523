"""Correlation that a perfect surrogate reaches with a metric that is known with noise."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from tracking.findings.generalist import JUDGEMENTS
from tracking.findings.paired import group_columns
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.statistics.confidence_interval import from_normal, to_normal
from tracking.statistics.jackknife import SampleError, combined, sample_error
from tracking.statistics.reliability import Noise, reliability, reliability_of_mean, without_seeds

_OF_NOISE = (
    *("n", "seeds", "agreement_of_seeds", "ceiling_by_seeds", "unit", "agreement_of_halves"),
    *("ceiling_by_objects", "ceiling", "ceiling_low", "ceiling_high"),
)
_OF_DETECTORS = ("agreement_of_detectors", "ceiling_by_detectors")


def ceilings(
    results: pd.DataFrame, left_out: pd.DataFrame | None = None, axes: Sequence[str] = ()
) -> pd.DataFrame:
    """Compute Spearman's rho that a surrogate without error or noise is expected to reach.

    By what the metric's means are unsure of (docs/statistics.md): seeds, of which two agree by
    ICC(3) where all placements have the same, elsewhere by ICC(1); test objects, by the jackknife's
    variance of a placement against the others; both, a little too low, as what seeds do to single
    objects is in both; and detectors, by the mean rho between two of them.

    `left_out` is of the run folder; without it the chance of the test objects is unknown. One row
    per `group_columns` with two placements or more: `n` placements; `seeds`, their mean number;
    `unit`, what was left out; agreements and ceilings by seeds, by test objects (of halves of
    these), by detectors; and `ceiling`, by seeds and objects as far as they are known, with its
    95 % interval. NaN and "" where it cannot be known."""
    keys = group_columns(axes)
    errors = _sample_errors(left_out, keys)
    rows, means = [], {}
    for key, of_group in results[results["value"].notna()].groupby(
        keys, dropna=False, observed=True
    ):
        y = of_group.pivot(index="placement", columns="seed", values="value")
        if len(y) < 2:
            continue
        group = dict(zip(keys, key, strict=True))
        error = errors.get(_without_difficulty(group))
        values = y.to_numpy(np.float64)
        mean, variance, degrees = without_seeds(values)
        seeds = Noise(np.isfinite(values).sum(axis=1) * 1.0, float(variance), float(degrees))
        means[key] = pd.Series(mean, y.index)
        estimates = _by_noise(mean, seeds, error)
        rows.append(group | dict(zip(_OF_NOISE, estimates, strict=True)))
    table = pd.DataFrame(rows, columns=[*keys, *_OF_NOISE])
    agreements = _between_detectors(means, keys.index("detector"))
    table[_OF_DETECTORS[0]] = [agreements[key] for key in means]
    normal = to_normal(table[_OF_DETECTORS[0]].to_numpy(np.float64).clip(0), "spearman")
    table[_OF_DETECTORS[1]] = ceiling(normal)
    return table


def with_ceilings(
    correlations: pd.DataFrame, ceilings: pd.DataFrame, axes: Sequence[str] = ()
) -> pd.DataFrame:
    """Add `ceiling`, `ceiling_low` and `ceiling_high` to every row of `correlations`.

    A generalist met the same test objects as the detectors that it predicts: its ceiling is that by
    seeds, without an interval."""
    keys, columns = group_columns(axes), ["ceiling", "ceiling_low", "ceiling_high"]
    table = correlations.merge(ceilings[[*keys, "ceiling_by_seeds", *columns]], on=keys, how="left")
    by_seeds, judged = table.pop("ceiling_by_seeds"), table["surrogate"].isin(JUDGEMENTS)
    table[columns] = table[columns].mask(judged)
    return table.assign(ceiling=table["ceiling"].mask(judged, by_seeds))


def _by_noise(
    means: NDArray[np.float64], seeds: Noise, error: SampleError | None
) -> tuple[object, ...]:
    """Compute the columns `_OF_NOISE` of means over seeds, shape (placements,)."""
    number = float(seeds.counts.mean())
    objects = Noise(np.ones(len(means)), np.nan, 0)
    if error is not None:
        objects = Noise(np.ones(len(means)), error.variance, error.degrees)
    both = combined(seeds, error) if seeds.degrees else objects
    of_seeds, of_objects, of_both = (
        reliability(means, noise.of_mean, noise.degrees) for noise in (seeds, objects, both)
    )
    return (
        len(means),
        number,
        float(reliability_of_mean(of_seeds[0], 1 / number)),
        float(ceiling(of_seeds[0])),
        error.unit if error else "",
        float(reliability_of_mean(of_objects[0], 0.5)),
        float(ceiling(of_objects[0])),
        *ceiling(of_both).tolist(),
    )


def _without_difficulty(group: dict[str, object]) -> tuple[object, ...]:
    """Make the key of a group in `left_out`; a missing value is equal to itself."""
    return tuple(
        None if pd.isna(value) else value  # type: ignore[call-overload]
        for key, value in group.items()
        if key != "difficulty"
    )


def _sample_errors(
    left_out: pd.DataFrame | None, keys: Sequence[str]
) -> dict[tuple[object, ...], SampleError | None]:
    """Estimate the error of a placement against the others, by group."""
    if left_out is None or left_out.empty:
        return {}
    columns = [key for key in keys if key != "difficulty"]
    return {
        _without_difficulty(dict(zip(columns, key, strict=True))): sample_error(rows, paired=True)
        for key, rows in left_out.groupby(columns, dropna=False, sort=False, observed=True)
    }


def _between_detectors(
    means: dict[tuple[object, ...], pd.Series], detector: int
) -> dict[tuple[object, ...], float]:
    """Average rho between two detectors over their common placements, by group."""
    alike: dict[str, list[tuple[object, ...]]] = {}
    for key in means:
        rest = repr((*key[:detector], *key[detector + 1 :]))  # NaN differs from itself
        alike.setdefault(rest, []).append(key)
    mean_rho: dict[tuple[object, ...], float] = {}
    for group in alike.values():
        pairs = [
            pd.concat([means[one], means[other]], axis=1, join="inner")
            for one, other in combinations(group, 2)
        ]
        rhos = [rank_agreement(pair.iloc[:, 0], pair.iloc[:, 1])[0] for pair in pairs]
        mean_rho |= dict.fromkeys(group, float(np.mean(rhos)) if rhos else np.nan)
    return mean_rho


def ceiling(reliable: ArrayLike) -> NDArray[np.float64]:
    """Compute Spearman's ρ of a metric of this reliability with what predicts it perfectly.

    sqrt(reliability), by attenuation (Spearman 1904), on the scale of a normal population's Pearson
    correlation. By luck a sample may exceed it."""
    return np.asarray(from_normal(np.sqrt(np.asarray(reliable, np.float64)), "spearman"))

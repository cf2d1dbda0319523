"""How often do the 95 % intervals of `tracking` hold the truth, and would others do better?

Placements are drawn from a population in which the correlation is known, their metric is measured
with seeds that scatter, and the interval is computed from that, many times. The truth is the
correlation of the surrogate with the metric as expected over seeds, also with one seed.

python benchmarks/studies/interval_coverage.py                # coefficients, the method in use
python benchmarks/studies/interval_coverage.py candidates     # beside other methods
python benchmarks/studies/interval_coverage.py paired         # seeds that shift all placements
python benchmarks/studies/interval_coverage.py means          # means over seeds

Leads of the best placement are in `decision.py` beside this file, differences between surrogates
in `surrogate_differences.py`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from hierarchical_bootstrap import hierarchical_resamples
from numpy.typing import NDArray
from scipy import stats

from tracking.findings.summary import seed_means
from tracking.statistics.coefficients import COEFFICIENTS, scores
from tracking.statistics.confidence_interval import (
    LEAST_RELIABLE,
    from_normal,
    intervals,
    to_normal,
)
from tracking.statistics.reliability import pooled_variance, seed_mean, without_seeds

Array = NDArray[np.float64]
SCIPY = {"pearson": stats.pearsonr, "spearman": stats.spearmanr, "kendall": stats.kendalltau}
SHAPES = ("normal", "heavy tails", "ties", "saturating")
RHOS = (0.0, 0.5, 0.9, -0.95)
SEEDS = ((1, 0.0), (1, 0.3), (2, 0.1), (2, 0.3), (3, 0.1), (3, 0.3), (5, 0.3), (2, 1.0), (3, 1.0))
"""Number of seeds, and their noise over the spread between placements."""


def population(shape: str, rho: float, size: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Surrogate and expected metric, shape (2, *size)."""
    x, e = rng.standard_normal((2, *size))
    y = rho * x + np.sqrt(1 - rho**2) * e
    if shape == "heavy tails":  # bivariate t with 3 degrees of freedom, variance 1
        scale = np.sqrt(rng.chisquare(3, size))
        x, y = x / scale, y / scale
    elif shape == "ties":
        x = np.round(x)
    elif shape == "saturating":
        y = -np.exp(-0.7 * y) / np.sqrt((np.exp(0.49) - 1) * np.exp(0.49))
    return np.stack([x, y])


def truth(shape: str, rho: float, coefficient: str) -> float:
    x, y = population(shape, rho, (400_000,), np.random.default_rng(7))
    return float(SCIPY[coefficient](x, y).statistic)


def coefficient_of(x: Array, y: Array, coefficient: str) -> Array:
    return (scores(x, coefficient) * scores(y, coefficient)).sum(axis=-1)


def percentile(x: Array, y: Array, coefficient: str) -> Array:
    drawn, means = hierarchical_resamples(y, 400, 0)
    values = coefficient_of(x[drawn], means, coefficient)
    return np.nanquantile(values, [0.025, 0.975])


def percentile_wider_seeds(x: Array, y: Array, coefficient: str) -> Array:
    s, mean = y.shape[1], y.mean(axis=1, keepdims=True)
    return percentile(x, mean + (y - mean) * np.sqrt(s / max(s - 1, 1)), coefficient)


def percentile_placements(x: Array, y: Array, coefficient: str) -> Array:
    return percentile(x, y.mean(axis=1, keepdims=True), coefficient)


def _without_each(x: Array, y: Array, coefficient: str) -> Array:
    n = len(x)
    others = np.array([np.delete(np.arange(n), i) for i in range(n)])
    return np.nan_to_num(coefficient_of(x[others], y.mean(axis=1)[others], coefficient))


def bca(x: Array, y: Array, coefficient: str) -> Array:
    mean = y.mean(axis=1)
    drawn, means = hierarchical_resamples(mean[:, None], 400, 0)
    values = coefficient_of(x[drawn], means, coefficient)
    values = values[np.isfinite(values)]
    estimate = coefficient_of(x, mean, coefficient)
    below = np.mean(values < estimate) + np.mean(values == estimate) / 2
    bias = stats.norm.ppf(np.clip(below, 0.001, 0.999))
    left = _without_each(x, y, coefficient)
    left = left.mean() - left
    spread = (left**2).sum() ** 1.5
    bend = (left**3).sum() / (6 * spread) if spread > 0 else 0.0
    z = bias + stats.norm.ppf([0.025, 0.975])
    return np.quantile(values, stats.norm.cdf(bias + z / (1 - bend * z)))


def jackknife(x: Array, y: Array, coefficient: str) -> Array:
    n = len(x)
    left = np.arctanh(np.clip(_without_each(x, y, coefficient), -0.999999, 0.999999))
    error = np.sqrt((n - 1) / n * ((left - left.mean()) ** 2).sum())
    estimate = np.clip(coefficient_of(x, y.mean(axis=1), coefficient), -0.999999, 0.999999)
    half = stats.t.ppf(0.975, n - 1) * error
    return np.tanh([np.arctanh(estimate) - half, np.arctanh(estimate) + half])


def fisher_z(x: Array, y: Array, coefficient: str) -> Array:
    """The method in use without the correction for the seeds' noise."""
    return intervals(x, y.mean(axis=1, keepdims=True), coefficient)


def seeds_unpaired(x: Array, y: Array, coefficient: str) -> Array:
    """As it was: both bounds over the root of ICC(1, k), as if each placement had other seeds."""
    mean = seed_mean(y)
    bounds = intervals(x, mean[..., None], coefficient)
    noise = pooled_variance(y)[0] / y.shape[-1]
    reliable = np.maximum(1 - noise / mean.var(axis=-1, ddof=1), LEAST_RELIABLE)
    freed = to_normal(bounds, coefficient) / np.sqrt(reliable)[..., None]
    return from_normal(np.clip(freed, -1, 1), coefficient)


CANDIDATES: dict[str, Callable[[Array, Array, str], Array]] = {
    "hierarchical percentile": percentile,
    "same, s/(s-1)": percentile_wider_seeds,
    "percentile": percentile_placements,
    "BCa": bca,
    "jackknife of z": jackknife,
    "normal z": fisher_z,
    "in use": intervals,
}


def sample(
    shape: str, rho: float, n: int, seeds: int, noise: float, times: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Surrogates (times, n) and metrics (times, n, seeds)."""
    x, mu = population(shape, rho, (times, n), rng)
    return x, mu[..., None] + noise * rng.standard_normal((times, n, seeds))


def _print(rows: Sequence[tuple[object, ...]], head: tuple[str, ...]) -> None:
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for row in rows:
        print("| " + " | ".join(map(str, row)) + " |")


def method_in_use(times: int) -> None:
    """Coverage at each number of placements: the range over rho, by shape, seeds and noise."""
    print(
        f"Percent, smallest to largest over rho in {RHOS}; standard error "
        f"{100 * np.sqrt(0.05 * 0.95 / times):.1f}"
    )
    rng, rows = np.random.default_rng(0), []
    for shape in SHAPES:
        true = {(rho, c): truth(shape, rho, c) for rho in RHOS for c in COEFFICIENTS}
        for seeds, noise in SEEDS if shape == "normal" else ((1, 0.0), (3, 0.3)):
            for n in (4, 5, 6, 8, 12, 20, 50):
                found: dict[str, list[float]] = {name: [] for name in COEFFICIENTS}
                for rho in RHOS:
                    x, y = sample(shape, rho, n, seeds, noise, times, rng)
                    for name, covers in found.items():
                        low, high = np.concatenate(
                            [
                                intervals(*part, name)
                                for part in zip(
                                    np.array_split(x, 8), np.array_split(y, 8), strict=True
                                )
                            ]
                        ).T
                        t = true[rho, name]
                        covers.append(100 * float(np.mean((low <= t) & (t <= high))))
                ranges = (f"{min(v):.1f} – {max(v):.1f}" for v in found.values())
                rows.append((shape, seeds, noise, n, *ranges))
    _print(rows, ("population", "seeds", "noise", "placements", *COEFFICIENTS))


def candidates(times: int) -> None:
    """Coverage of each method in normal populations."""
    print(f"Percent; standard error {100 * np.sqrt(0.05 * 0.95 / times):.1f}")
    rng, rows = np.random.default_rng(0), []
    for n in (6, 8, 20):
        for seeds, noise in ((1, 0.3), (3, 0.3), (2, 1.0)):
            for rho in (0.0, 0.9):
                x, y = sample("normal", rho, n, seeds, noise, times, rng)
                for name in COEFFICIENTS:
                    t, row = truth("normal", rho, name), []
                    for method in CANDIDATES.values():
                        bounds = np.array([method(a, b, name) for a, b in zip(x, y, strict=True)])
                        covers = (bounds[:, 0] <= t) & (t <= bounds[:, 1])
                        row.append(f"{100 * covers.mean():.0f}")
                    rows.append((name, n, seeds, noise, rho, *row))
    _print(rows, ("coefficient", "placements", "seeds", "noise", "rho", *CANDIDATES))


def paired(times: int) -> None:
    """Spearman's rho where each seed adds the same to all placements, also without a training."""
    print(f"Percent; standard error {100 * np.sqrt(0.05 * 0.95 / times):.1f}")
    rng, rows = np.random.default_rng(0), []
    for n in (8, 24):
        for seeds, noise in ((3, 0.5), (3, 1.0), (2, 0.5), (2, 1.0)):
            for rho in (0.5, 0.8, 0.9):
                row = []
                for effect in (0.0, 1.0, 3.0):
                    normal = float(to_normal(np.array(rho), "spearman"))
                    x, y = sample("normal", normal, n, seeds, noise, times, rng)
                    y += noise * effect * rng.standard_normal((times, 1, seeds))
                    fewer = y.copy()
                    fewer[:, 0, 0] = np.nan
                    cell = []
                    for method, z in ((seeds_unpaired, y), (intervals, y), (intervals, fewer)):
                        estimate = coefficient_of(x, without_seeds(z)[0], "spearman")
                        low, high = method(x, z, "spearman").T
                        held = 100 * np.mean((low <= rho) & (rho <= high))
                        lost = 100 * np.mean((estimate < low - 1e-9) | (estimate > high + 1e-9))
                        cell.append(f"{held:.0f} ({lost:.0f})")
                    row.append(", ".join(cell))
                rows.append((n, seeds, noise, rho, *row))
    head = ("placements", "seeds", "noise", "rho", "seed effect 0", "1", "3 times the noise")
    print("As it was, in use, with one training missing; in brackets: the estimate is outside")
    _print(rows, head)


def means(times: int) -> None:
    """Coverage of the interval of a placement's mean over seeds."""
    print(
        f"Percent; standard error at most {100 * np.sqrt(0.05 * 0.95 / times):.1f}. Noise 1; "
        "unequal: its sd is 0.5 for the first half of the placements and 1.3 for the rest; "
        "shifted: each seed adds the same to all placements, with a sd of 1 and of 3"
    )
    rng, rows = np.random.default_rng(0), []
    for n in (2, 8, 24):
        for seeds in (2, 3, 5):
            row: list[object] = [n, seeds]
            for unequal, effect in ((False, 0.0), (True, 0.0), (False, 1.0), (False, 3.0)):
                sd = np.where(np.arange(n) < n / 2, 0.5, 1.3)[:, None] if unequal else 1.0
                mu = 50 + np.arange(n) / 2
                held = []
                for _ in range(times):
                    y = mu[:, None] + sd * rng.standard_normal((n, seeds))
                    y += effect * rng.standard_normal(seeds)
                    table = pd.DataFrame(
                        {
                            "placement": np.repeat(np.arange(n), seeds),
                            "seed": np.tile(np.arange(seeds), n),
                            "value": y.ravel(),
                            "ground_truths": 1,
                            "class": "Car",
                        }
                    ).assign(detector="d", metric="m", iou=0.7, difficulty="all")
                    mean = seed_means(table).set_index("placement")
                    held.append(((mean["low"] <= mu) & (mu <= mean["high"])).mean())
                row.append(f"{100 * np.mean(held):.1f}")
            rows.append(tuple(row))
    heads = ("equal scatter", "unequal scatter", "shifted by 1", "shifted by 3")
    _print(rows, ("placements", "seeds", *heads))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "what", nargs="?", default="in-use", choices=["in-use", "candidates", "paired", "means"]
    )
    parser.add_argument("--times", type=int, help="samples of a case")
    arguments = parser.parse_args()
    runs = {
        "in-use": (method_in_use, 2000),
        "candidates": (candidates, 500),
        "paired": (paired, 2000),
        "means": (means, 500),
    }
    run, times = runs[arguments.what]
    run(arguments.times or times)


if __name__ == "__main__":
    main()

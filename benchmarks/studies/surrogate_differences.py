"""How often do the intervals between two surrogates' \\|rho\\| hold the truth, or tell too much?

    python benchmarks/studies/surrogate_differences.py              # all three tables
    python benchmarks/studies/surrogate_differences.py --times 100

Surrogates and the expected metric are normal with known correlations; each placement's metric is
measured with seeds that scatter with `noise` times the spread between placements. The truth is
Spearman's rho with the expected metric. As in the report, the first surrogate is the strongest in
the sample. "Bootstrap" is the percentile interval of a hierarchical bootstrap, one pair at a time.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pandas as pd
import typer
from hierarchical_bootstrap import hierarchical_resamples
from numpy.typing import NDArray

from tracking.findings.best_surrogate import Predictors, best_surrogates
from tracking.findings.correlation import correlate, leave_one_out
from tracking.statistics.coefficients import scores
from tracking.statistics.confidence_interval import strength_leads
from tracking.statistics.reliability import seed_mean

Array = NDArray[np.float64]
PLACEMENTS = (6, 8, 12, 20)
SEEDS = ((1, 0.3, 0), (3, 0.3, 0), (3, 0.3, 3), (3, 1.0, 0))
"""Number of seeds, their noise over the spread between placements, and what each adds to all
placements alike, over that noise."""

PAIRS = (
    (0.0, 0.0, 0.0),
    (0.5, 0.5, 0.5),
    (0.8, 0.8, 0.5),
    (0.9, 0.9, 0.9),
    (0.8, 0.4, 0.3),
    (0.9, 0.7, 0.8),
    (0.9, 0.0, 0.0),
    (0.95, -0.6, -0.6),
)
"""Correlations of two surrogates with the metric, and with each other (Pearson's)."""

DESIGN = ("seeds", "noise", "shift")
ALIKE = ((0.0, 0.0), (0.5, 0.5), (0.8, 0.7), (0.9, 0.9))
"""Correlation of equally good surrogates with the metric, and of each pair of them."""

SURROGATES = ("s_mig", "expected_ig", "m_sog", "expected_points", "covered_voxels")
RESAMPLES = 400


def correlations(with_metric: tuple[float, ...], between: float) -> Array:
    """Correlation matrix of surrogates and, last, the metric."""
    k = len(with_metric)
    matrix = np.full((k + 1, k + 1), between)
    matrix[-1, :k] = matrix[:k, -1] = with_metric
    np.fill_diagonal(matrix, 1.0)
    return matrix


def sample(
    matrix: Array, n: int, design: tuple[int, float, int], times: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Surrogates (times, k, n) and metrics (times, n, seeds); `design` is one of SEEDS."""
    seeds, noise, shift = design
    drawn = rng.multivariate_normal(np.zeros(len(matrix)), matrix, (times, n))
    measured = drawn[..., -1:] + noise * rng.standard_normal((times, n, seeds))
    measured += shift * noise * rng.standard_normal((times, 1, seeds))
    return np.swapaxes(drawn[..., :-1], 1, 2), measured


def strongest_first(x: Array, y: Array) -> tuple[Array, NDArray[np.intp]]:
    """Surrogates by falling \\|rho\\| in each sample, and their order, shape (times, k)."""
    found = scores(x, "spearman") * scores(seed_mean(y), "spearman")[:, None]
    order = np.argsort(-np.abs(found.sum(axis=-1)), axis=1, kind="stable")
    return np.take_along_axis(x, order[..., None], axis=1), order


def bootstrap(x: Array, y: Array, seed: int) -> Array:
    """Percentile intervals of \\|rho\\| of the first row of `x` less each other, (k - 1, 2)."""
    drawn, means = hierarchical_resamples(y, RESAMPLES, seed)
    of_y = scores(means, "spearman")
    strengths = np.array([np.abs((scores(row[drawn], "spearman") * of_y).sum(axis=1)) for row in x])
    return np.nanquantile(strengths[:1] - strengths[1:], [0.025, 0.975], axis=1).T


def methods(x: Array, y: Array) -> dict[str, Array]:
    """Intervals of each method, shape (times, k - 1, 2)."""
    resampled = [bootstrap(a, b, i) for i, (a, b) in enumerate(zip(x, y, strict=True))]
    return {"bootstrap": np.array(resampled), "in use": strength_leads(x, y)}


def coverage(times: int, rng: np.random.Generator) -> pd.DataFrame:
    """Two surrogates: how often the interval holds the truth, and tells them apart."""
    rows = []
    for one, two, between in PAIRS:
        strengths = 6 / np.pi * np.arcsin(np.abs([one, two]) / 2)  # Spearman's rho
        for n in PLACEMENTS:
            for design in SEEDS:
                matrix = correlations((one, two), between)
                x, y = sample(matrix, n, design, times, rng)
                x, order = strongest_first(x, y)
                lead = strengths[order[:, 0]] - strengths[order[:, 1]]
                row: dict[str, object] = {"correlations": f"{one}, {two}; {between}"}
                row |= {"placements": n} | dict(zip(DESIGN, design, strict=True))
                for name, found in methods(x, y).items():
                    low, high = found[:, 0].T
                    row[f"covered, {name}"] = 100 * np.mean((low <= lead) & (lead <= high))
                    row[f"told, {name}"] = 100 * np.mean(low > 0)
                rows.append(row)
    return pd.DataFrame(rows)


def told_of_equals(times: int, rng: np.random.Generator) -> pd.DataFrame:
    """Equally good surrogates: how often the strongest is told from at least one other."""
    rows = []
    for n in PLACEMENTS:
        for design in SEEDS:
            row: dict[str, object] = {"placements": n} | dict(zip(DESIGN, design, strict=True))
            for k in (2, 5):
                found: dict[str, list[float]] = {}
                for strength, between in ALIKE:
                    matrix = correlations((strength,) * k, between)
                    x, y = sample(matrix, n, design, times, rng)
                    x, _ = strongest_first(x, y)
                    for name, bounds in methods(x, y).items():
                        told = 100 * float((bounds[..., 0] > 0).any(axis=1).mean())
                        found.setdefault(name, []).append(told)
                for name, shares in found.items():
                    row[f"{k} surrogates, {name}"] = f"{min(shares):.1f} – {max(shares):.1f}"
            rows.append(row)
    return pd.DataFrame(rows)


def asked(x: Array, y: Array) -> Predictors:
    """What the report says of surrogates (k, n) and a metric (n, seeds)."""
    n, seeds = y.shape
    results = pd.DataFrame(
        {
            "class": "Car",
            "placement": np.repeat(np.arange(n), seeds),
            "seed": np.tile(np.arange(seeds), n),
            "value": y.ravel(),
        }
    ).assign(detector="d", metric="AP_R40_3D", iou=0.7, difficulty="all")
    surrogates = pd.DataFrame(
        {
            "class": "Car",
            "placement": np.tile(np.arange(n), len(x)),
            "surrogate": np.repeat(SURROGATES[: len(x)], n),
            "value": x.ravel(),
        }
    )
    tables = results, surrogates
    (found,) = best_surrogates(*tables, correlate(*tables), leave_one_out(*tables))
    return found


def sentences(times: int, rng: np.random.Generator) -> pd.DataFrame:
    """The report's whole finding for five surrogates, in percent of studies."""
    rows = []
    truths = {
        "none predicts": ((0.0,) * 5, 0.5),
        "all predict alike": ((0.9,) * 5, 0.9),
        "one is better": ((0.95, 0.5, 0.5, 0.5, 0.5), 0.45),
    }
    for truth, (strengths, between) in truths.items():
        for n in PLACEMENTS:
            for design in SEEDS[:3]:
                matrix = correlations(strengths, between)
                x, y = sample(matrix, n, design, times, rng)
                found = [asked(a, b) for a, b in zip(x, y, strict=True)]
                named = np.array([one.predictor for one in found])
                low = [one.ranking["behind_low"] for one in found]
                told = (named != "") & [bool((one > 0).any()) for one in low]
                row: dict[str, object] = {"truth": truth, "placements": n}
                row |= dict(zip(DESIGN, design, strict=True))
                row["names a predictor"] = 100 * np.mean(named != "")
                row["and tells it from another"] = 100 * np.mean(told)
                row["names the better"] = (
                    100 * np.mean(named == SURROGATES[0]) if truth == "one is better" else np.nan
                )
                rows.append(row)
    return pd.DataFrame(rows)


def show(title: str, table: pd.DataFrame) -> None:
    """Print a Markdown table; percents without decimals."""
    print(f"\n{title}\n\n| " + " | ".join(table.columns) + " |\n" + "|---" * table.shape[1] + "|")
    percents = table.select_dtypes(float).columns.difference(["noise"])
    text = table.assign(**{name: table[name].map(_percent) for name in percents})
    for row in text.itertuples(index=False):
        print("| " + " | ".join(map(str, row)) + " |", flush=True)


def _percent(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.0f}"


def main(
    times: Annotated[int, typer.Option(min=2, help="samples of a case")] = 500,
    studies: Annotated[int, typer.Option(min=2, help="whole studies of a case")] = 100,
) -> None:
    rng = np.random.default_rng(0)
    print(
        f"Percent; {times} samples of a case, of whole studies {studies}: standard error of 95 % "
        f"{100 * np.sqrt(0.05 * 0.95 / times):.1f} and {100 * np.sqrt(0.05 * 0.95 / studies):.1f}"
    )
    show("Two surrogates, nominal coverage 95 %", coverage(times, rng))
    show(
        "Equally good, told from at least one other; the range over strengths of 0 to 0.9",
        told_of_equals(times, rng),
    )
    show("Five surrogates, whole studies", sentences(studies, rng))


if __name__ == "__main__":
    typer.run(main)

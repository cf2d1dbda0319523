"""How often is one of 2,000 tests significant although no surrogate predicts anything?

python benchmarks/studies/permutation_tail.py

Families of one metric and 2,000 surrogates, corrected by Holm's method at 5 %. Surrogates are
independent, or share a part, by which they correlate by 0.8. "Parametric" has scipy's p-value
wherever none of 9,999 random orders is as extreme.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tracking.statistics.coefficients import permutation_p, scores

TESTS = 2000
STRONGEST = 10  # tests whose p-values are computed: the smallest of a family is among them
PARAMETRIC = {"pearson": stats.pearsonr, "spearman": stats.spearmanr}
CASES = (
    ("normal", "pearson"),
    ("heavy tails", "pearson"),
    ("normal", "spearman"),
    ("ties", "spearman"),
)


def population(shape: str, size: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw normal numbers, Student's t with 2 degrees of freedom, or numbers rounded to 0.5."""
    if shape == "heavy tails":
        return rng.standard_t(2, size)
    values = rng.standard_normal(size)
    return np.round(2 * values) / 2 if shape == "ties" else values


def smallest_p(
    shape: str, coefficient: str, shared: float, n: int, rng: np.random.Generator
) -> tuple[float, float]:
    """The smallest p-value of a family, parametric in the tail and as in use."""
    common, y = population(shape, (2, n), rng)
    x = population(shape, (TESTS, n), rng)
    if shared:
        x = np.sqrt(shared) * common + np.sqrt(1 - shared) * x
    strength = np.abs(scores(x, coefficient) @ scores(y, coefficient))
    x = x[np.argsort(-strength)[:STRONGEST]]
    p = permutation_p(x, y, coefficient)
    unseen = rng.random(len(p)) < (1 - p / 2) ** 9_999
    parametric = [PARAMETRIC[coefficient](row, y).pvalue for row in x]
    return np.where(unseen, np.minimum(p, parametric), p).min(), p.min()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=200, help="families of a case")
    times = parser.parse_args().times
    print(f"Percent of {times} families; standard error {100 * np.sqrt(0.0475 / times):.1f}")
    print("| population | coefficient | surrogates | placements | parametric | in use |")
    print("|---|---|---|---|---|---|")
    rng = np.random.default_rng(0)
    for shape, coefficient in CASES:
        for shared, n in ((0.0, 10), (0.0, 12), (0.0, 24), (0.8, 12)):
            p = [smallest_p(shape, coefficient, shared, n, rng) for _ in range(times)]
            false = 100 * (np.array(p) * TESTS <= 0.05).mean(axis=0)
            kind = "share a part" if shared else "independent"
            cells = f"{false[0]:.0f} | {false[1]:.0f}"
            print(f"| {shape} | {coefficient} | {kind} | {n} | {cells} |", flush=True)


if __name__ == "__main__":
    main()

"""Do intervals of all pairs hold where routes matter more for some rigs than for others?

    python benchmarks/studies/all_pairs_coverage.py

A metric is the mean over routes of what a rig reaches there. Routes shift each rig by an error of
its own, whose sd is the same for all rigs, or rises from 1 to 3 over them. "Pooled" has one
variance for all pairs, "own" the jackknife's of each pair alone, "in use" is moderated from 12
effective routes on. Percent of studies in which the intervals of all pairs hold, and the mean half
width.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from tracking.statistics.all_pairs import AllPairs
from tracking.statistics.jackknife import SampleError, sample_error
from tracking.statistics.reliability import Noise

Array = NDArray[np.float64]


def left_out_of(values: Array) -> pd.DataFrame:
    """Left-out table of means over routes, from values of shape (routes, rigs)."""
    routes, rigs = values.shape
    without = (values.sum(axis=0) - values) / (routes - 1)
    table = {"placement": np.tile(np.arange(rigs), routes), "seed": 1, "unit": "route"}
    table |= {"left_out": np.repeat(np.arange(routes), rigs), "ground_truths": 10}
    return pd.DataFrame(table | {"value": without.ravel()})


def own_variances(error: SampleError) -> tuple[Array, float]:
    """Of each pair alone, with the degrees of freedom of the routes."""
    covariance = error.covariance.to_numpy(np.float64)
    diagonal = np.diag(covariance)
    return np.add.outer(diagonal, diagonal) - 2 * covariance, error.units


def held(pairs: AllPairs) -> tuple[bool, float]:
    """Whether the intervals of all pairs hold 0, and their mean half width."""
    n = len(pairs.means)
    bounds = np.stack([pairs.intervals(at) for at in range(n)])[~np.eye(n, dtype=bool)]
    inside = (bounds[:, 0] <= 0) & (bounds[:, 1] >= 0)
    return bool(inside.all()), float(np.diff(bounds, axis=1).mean() / 2)


def case(rigs: int, routes: int, spread: Array, times: int) -> list[str]:
    """Cells of a row."""
    rng, found = np.random.default_rng(0), []
    none = Noise(np.ones(rigs), np.nan, 0)
    for _ in range(times):
        values = spread * rng.standard_normal((routes, rigs))
        means, error = values.mean(axis=0), sample_error(left_out_of(values), paired=True)
        assert error is not None
        pooled = AllPairs.of(means, none, replace(error, units=0.0), alone=True)
        variance, degrees = own_variances(error)
        own = AllPairs(means, variance, np.full(variance.shape, degrees))
        in_use = AllPairs.of(means, none, error, alone=True)
        found.append([held(pairs) for pairs in (pooled, own, in_use)])
    share, half = np.mean(found, axis=0).T
    return [f"{100 * a:.0f} (± {b:.2f})" for a, b in zip(share, half, strict=True)]


def main(times: Annotated[int, typer.Option(min=2, help="studies of a case")] = 400) -> None:
    error = 100 * np.sqrt(0.05 * 0.95 / times)
    print(f"{times} studies of a case: the standard error of 95 % is {error:.1f} points")
    print("| rigs | routes | sd over rigs | pooled | own | in use |\n" + "|---" * 6 + "|")
    for rigs in (4, 8, 24):
        for routes in (4, 8, 12, 16, 32):
            for name, spread in (("equal", np.ones(rigs)), ("1 to 3", np.linspace(1, 3, rigs))):
                cells = (f"{rigs}", f"{routes}", name, *case(rigs, routes, spread, times))
                print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    typer.run(main)

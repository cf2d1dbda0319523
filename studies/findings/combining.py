"""Two or three numbers that need no training, combined: is that better than the best one?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats


@dataclass(frozen=True)
class Combination:
    """A linear regression of ranks whose terms were chosen anew without each rig.

    Attributes:
        rho: Spearman's, of the predictions for rigs left out with what their detectors reach.
        terms: those that all rigs together choose.
    """

    rho: float
    terms: tuple[str, ...]


def combined(x: pd.DataFrame, y: pd.Series, number: int) -> Combination:
    """The best `number` terms by the squared errors of rigs left out, for each rig without it.

    Args:
        x: a row a rig, a column a predictor; y: the same rigs.
    """
    choices = list(combinations(range(x.shape[1]), number))
    # A rig that collapses would draw any line of values to itself. Ranks are those among the other
    # rigs: among all, the ranks of the others would tell that of the rig left out.
    values, own = x.to_numpy(np.float64), y.to_numpy(np.float64)
    said = np.empty(len(own))
    for rig in range(len(own)):
        rest, target = np.delete(values, rig, axis=0), stats.rankdata(np.delete(own, rig))
        ranks = _ranks(rest, rest)
        terms = list(_best(ranks, target, choices))
        weights = np.linalg.lstsq(_design(ranks[:, terms]), target, rcond=None)[0]
        said[rig] = (_design(_ranks(values[[rig]], rest)[:, terms]) @ weights)[0]
    chosen = _best(_ranks(values, values), stats.rankdata(own), choices)
    return Combination(
        rho=float(stats.spearmanr(said.round(9), own).statistic),
        terms=tuple(x.columns[list(chosen)]),
    )


def shares(x: pd.DataFrame, y: pd.Series) -> pd.Series:
    """The part of the variance of y that each column explains, over all orders of the columns.

    The mean rise of adjusted R² when the column is added to some of the others (the Shapley value;
    Lindeman, Merenda and Gold 1980 have R²). They add up to adjusted R² of all columns. Of a column
    that explains no more than chance the part is 0 on average.
    """
    values, own = x.to_numpy(np.float64), y.to_numpy(np.float64)
    count = x.shape[1]
    explained = {
        subset: _explained(values[:, list(subset)], own)
        for size in range(count + 1)
        for subset in combinations(range(count), size)
    }
    found = np.zeros(count)
    for subset, base in explained.items():
        for column in set(range(count)) - set(subset):
            weight = 1 / (count * math.comb(count - 1, len(subset)))
            found[column] += weight * (explained[tuple(sorted((*subset, column)))] - base)
    return pd.Series(found, x.columns)


def _ranks(x: NDArray[np.float64], among: NDArray[np.float64]) -> NDArray[np.float64]:
    """The ranks that rows of `x` have among those of `among`, in every column."""
    below, up_to = ((than(among, x[:, None])).sum(axis=1) for than in (np.less, np.less_equal))
    return (below + up_to + 1) / 2


def _best(
    x: NDArray[np.float64], y: NDArray[np.float64], choices: Sequence[tuple[int, ...]]
) -> tuple[int, ...]:
    """The choice of columns with the least squared error of rows left out."""
    return min(choices, key=lambda terms: _left_out_error(_design(x[:, terms]), y))


def _left_out_error(design: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Without a fit for each row: a residual over one less its leverage (Allen 1974)."""
    q, _ = np.linalg.qr(design)
    residual = y - q @ (q.T @ y)
    leverage = np.square(q).sum(axis=1)
    return float(np.square(residual / (1 - leverage)).sum())


def _explained(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Adjusted R² of the least-squares plane."""
    design = _design(x)
    fitted = design @ np.linalg.lstsq(design, y, rcond=None)[0]
    free = len(y) - design.shape[1]
    return 1 - float(np.square(y - fitted).sum() / free / np.var(y, ddof=1))


def _design(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([np.ones(len(x)), x])

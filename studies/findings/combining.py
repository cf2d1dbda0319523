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
    # A rig that collapses would draw any line of values to itself.
    values, own = stats.rankdata(x, axis=0), stats.rankdata(y)
    said = np.empty(len(own))
    for rig in range(len(own)):
        rest = np.arange(len(own)) != rig
        terms = _best(values[rest], own[rest], choices)
        design = _design(values[:, terms])
        weights = np.linalg.lstsq(design[rest], own[rest], rcond=None)[0]
        said[rig] = design[rig] @ weights
    return Combination(
        rho=float(stats.spearmanr(said, own).statistic),
        terms=tuple(x.columns[list(_best(values, own, choices))]),
    )


def shares(x: pd.DataFrame, y: pd.Series) -> pd.Series:
    """The part of the variance of y that each column explains, over all orders of the columns.

    The mean rise of R² when the column is added to some of the others (Lindeman, Merenda and Gold
    1980; the Shapley value of R²). They add up to R² of all columns.
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
    """R² of the least-squares plane."""
    design = _design(x)
    fitted = design @ np.linalg.lstsq(design, y, rcond=None)[0]
    return 1 - float(np.square(y - fitted).sum() / np.square(y - y.mean()).sum())


def _design(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([np.ones(len(x)), x])

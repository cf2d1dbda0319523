"""Expected IG at the detection probability that fits best: does that make it a better predictor?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from predicting import read
from rig_results import SHORT, RigResults, head_of, number, table
from scipy import stats

from tracking.statistics.straight_line import left_out_means, rmse

TARGETS = ("car07", "car", "recall")
CUSTOMARY = 0.1
"""q of a sweep that is told nothing else."""


def fitted_table(rigs: RigResults) -> str:
    """q fitted to all rigs; rho and error of predictions for rigs left out, and without a fit."""
    rows = []
    for target in TARGETS:
        gains, measured = _by_q(SHORT[target][0]), rigs.means(target)
        gains = gains.loc[measured.index]
        found = fit_detection_probability(gains, measured)
        said = found.placements["predicted"]
        rows.append(
            [
                head_of(target),
                number(found.q, 4),
                number(stats.spearmanr(said, measured.loc[said.index]).statistic),
                number(stats.spearmanr(gains[CUSTOMARY], measured).statistic),
                number(found.rmse, 1),
                number(found.rmse_of_mean, 1),
            ]
        )
    head = ("fitted q", "ρ, rig left out", f"ρ at {CUSTOMARY}", "error", "error of the mean")
    return table(["", *head], rows)


def _by_q(object_class: str) -> pd.DataFrame:
    """A row a rig, a column a q; the sum of all classes for "all".

    `lidarplace.expected_ig_of_rays` of the sweep `findings_generalist`, at 25 values of q.
    """
    rows = read("expected_ig_by_q")
    if object_class != "all":
        rows = rows[rows["class"] == object_class]
    return rows.pivot_table(index="placement", columns="q", values="expected_ig", aggfunc="sum")


@dataclass(frozen=True)
class FittedDetectionProbability:
    """Result of `fit_detection_probability`.

    Attributes:
        q: fitted to all placements.
        placements: a row a placement: `measured`, `q` fitted without it, and `predicted` from the
            others; index placement.
        rmse: of the predictions, in the unit of the measured metric.
        rmse_of_mean: of predicting each placement by the mean of the others; a surrogate that
            says anything has a smaller `rmse`.
    """

    q: float
    placements: pd.DataFrame
    rmse: float
    rmse_of_mean: float


def fit_detection_probability(
    expected_ig: pd.DataFrame, measured: pd.Series
) -> FittedDetectionProbability:
    """Fit q of `expected_ig` to a measured metric, leaving one placement out at a time.

    For every q the metric is a straight line of `expected_ig` by least squares, of either sign;
    the q of the smallest residual wins. For each placement this is done with the others, and their
    line predicts its metric.

    Args:
        expected_ig: a row a placement (index), a column a q; nats, finite.
        measured: AP or recall by placement (same index in any order, at least
            four), percent.
    """
    gains = expected_ig.to_numpy(np.float64)
    metric = measured.reindex(expected_ig.index).to_numpy(np.float64)
    qs = expected_ig.columns.to_numpy(np.float64)

    predicted, chosen = left_out_predictions(gains, metric)
    table = pd.DataFrame(
        {"measured": metric, "q": qs[chosen], "predicted": predicted}, index=expected_ig.index
    )
    return FittedDetectionProbability(
        q=float(qs[best_line(gains, metric)[0]]),
        placements=table,
        rmse=rmse(predicted, metric),
        rmse_of_mean=rmse(left_out_means(metric), metric),
    )


def best_line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[int, float, float]:
    """The column of `x` whose least-squares line leaves the smallest residual of `y`.

    Args:
        x: shape (n, k).
        y: shape (n,).

    Returns:
        The column, and slope and intercept of its line. A constant column predicts the mean.
    """
    centred = x - x.mean(axis=0)
    spread = (centred**2).sum(axis=0)
    slope = (centred.T @ (y - y.mean())) / np.where(spread > 0, spread, 1.0)
    residual = ((y - y.mean())[:, None] - slope * centred) ** 2
    best = int(np.argmin(residual.sum(axis=0)))
    return best, float(slope[best]), float(y.mean() - slope[best] * x[:, best].mean())


def left_out_predictions(
    x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Each value of `y` from `best_line` through the others.

    Args:
        x: shape (n, k).
        y: shape (n,).

    Returns:
        The predictions, and the columns that the others chose, both shape (n,).
    """
    # Numbers near 1e300 or 1e-300 have no squares: the largest of a column becomes 1.
    peak = np.abs(x).max(axis=0)
    scaled = x / np.where(peak > 0, peak, 1.0)
    predictions, columns = np.empty(len(y)), np.empty(len(y), dtype=np.intp)
    for i in range(len(y)):
        others = np.arange(len(y)) != i
        columns[i], slope, intercept = best_line(scaled[others], y[others])
        predictions[i] = intercept + slope * scaled[i, columns[i]]
    return predictions, columns

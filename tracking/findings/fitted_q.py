"""Which detection probability q makes `expected_ig` agree best with measured AP?

q is chosen from the results it is judged by, so a fit to all placements flatters itself. Leaving
one placement out at a time says how well AP is predicted for a placement that was not measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tracking.statistics.straight_line import best_line, left_out_means, left_out_predictions, rmse

LEAST_PLACEMENTS = 4
"""With fewer, a line and q pass through all points that are left."""


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
        expected_ig: a row a placement (index), a column a q; nats. `lidarplace.expected_ig_by_q`
            computes the rows.
        measured: AP or recall by placement (same index in any order), percent.

    Raises:
        ValueError: the placements differ, are fewer than LEAST_PLACEMENTS, or a value is missing.
    """
    if set(expected_ig.index) != set(measured.index) or not expected_ig.index.is_unique:
        raise ValueError(
            "expected_ig and measured need the same placements, found "
            f"{sorted(map(str, expected_ig.index))} and {sorted(map(str, measured.index))}"
        )
    if len(measured) < LEAST_PLACEMENTS:
        raise ValueError(
            f"at least {LEAST_PLACEMENTS} placements are needed, found {len(measured)}"
        )
    gains = expected_ig.to_numpy(np.float64)
    metric = measured.reindex(expected_ig.index).to_numpy(np.float64)
    if not (np.isfinite(gains).all() and np.isfinite(metric).all()):
        raise ValueError("expected_ig and measured must be finite for every placement")
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

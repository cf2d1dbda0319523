"""How well expected IG predicts AP with a fitted probability of detection."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tracking.findings.groups import Group
from tracking.findings.summary import surrogates_of
from tracking.kitti_iou import judged
from tracking.pages.section import Column, Table, numbers, words
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.straight_line import best_line, left_out_means, left_out_predictions, rmse

LEAST_PLACEMENTS = 4
"""With fewer, a line and q pass through all points that are left."""


def fitted_q_table(
    run: RunFolder, by_q: pd.DataFrame, found: Sequence[Group], means: pd.DataFrame
) -> Table | None:
    """How well expected IG predicts headline AP with a fitted q; None for too few placements.

    Args:
        by_q: `expected_ig_by_q.parquet`: placement, axes, class, q, expected_ig.
        means: `tracking.findings.summary.seed_means`.
    """
    rows = []
    for group in found:
        for name in run.classes:
            own = judged(group.of(means), run.results, name)
            measured: pd.Series = own.set_index("placement")["mean"].dropna()
            gains = surrogates_of(by_q, group.setting, name, "q", "expected_ig")
            common = measured.index.intersection(gains.index)
            if len(common) < LEAST_PLACEMENTS:
                continue
            fitted = fit_detection_probability(gains.loc[common], measured.loc[common])
            left_out = fitted.placements["q"]
            rows.append(
                {
                    "title": group.title,
                    "class": name,
                    "detector": group.detector,
                    **group.setting,
                    "q": fitted.q,
                    "q_one_left_out_min": left_out.min(),
                    "q_one_left_out_max": left_out.max(),
                    "rmse (points)": fitted.rmse,
                    "rmse_of_mean (points)": fitted.rmse_of_mean,
                }
            )
    if not rows:
        return None
    table = pd.DataFrame(rows)
    rmse, of_mean = "rmse (points)", "rmse_of_mean (points)"
    columns = [
        words("class"),
        words("detector", "title"),
        numbers("q", "q", ".2g"),
        Column(
            "q, one left out",
            lambda row: f"{row['q_one_left_out_min']:.2g} to {row['q_one_left_out_max']:.2g}",
        ),
        numbers("RMSE", rmse, ".2f"),
        numbers("RMSE of the mean", of_mean, ".2f"),
        Column(
            "than the mean",
            lambda row: "better" if row[rmse] < row[of_mean] else "not better",
            words=True,
        ),
    ]
    return Table.of(
        "q of expected IG fitted to 3D AP; each placement predicted from the others, errors in AP",
        table,
        columns,
        name="fitted-q",
        data=table.drop(columns="title"),
    )


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
            `lidarplace.expected_ig_by_q` computes the rows.
        measured: AP or recall by placement (same index in any order, at least
            `LEAST_PLACEMENTS`), percent.
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

"""How well expected IG predicts AP with a fitted probability of detection."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from tracking.findings.fitted_q import LEAST_PLACEMENTS, fit_detection_probability
from tracking.findings.groups import Group
from tracking.findings.summary import surrogates_of
from tracking.kitti_iou import judged
from tracking.pages.tables import Column, Table, numbers, words
from tracking.run_folders.sweep import RunFolder


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

"""Expected IG at the detection probability that fits best: does that make it a better predictor?"""

from __future__ import annotations

import pandas as pd
from judged import SHORT, Judged, head_of, number, table
from predicting import read
from scipy import stats

from tracking.report.sections.correlation import fit_detection_probability

TARGETS = ("car07", "car", "recall")
CUSTOMARY = 0.1
"""q of a sweep that is told nothing else."""


def fitted_table(rigs: Judged) -> str:
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
    """A row a rig, a column a q; the sum of all classes for "all"."""
    rows = read("expected_ig_by_q")
    if object_class != "all":
        rows = rows[rows["class"] == object_class]
    return rows.pivot_table(index="placement", columns="q", values="expected_ig", aggfunc="sum")

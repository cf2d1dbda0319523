"""The one look at the rigs that were set aside: do predictors do there what they did before?"""

from __future__ import annotations

import numpy as np
import pandas as pd
from predicting import PREDICTORS, equal_budget, every_predictor
from rig_results import SHORT, RigResults, head_of, label, number, table
from scipy import stats

TARGETS = ("car", "recall")
FORETOLD = ("generalist", "expected_recall", "log_cells", "covered_entropy", "expected_points")
"""Predictors by which values are foretold."""


def aside_table(seen: RigResults, aside: RigResults) -> str:
    """Spearman's rho of each predictor over rigs that were looked at, and over those set aside.

    Of each target over all rigs, and over those of the same LiDARs.
    """
    groups = [
        seen,
        aside,
        RigResults(equal_budget(seen.rigs)),
        RigResults(equal_budget(aside.rigs)),
    ]
    rows = [
        [label(name), *(number(_rho(group, name, t)) for t in TARGETS for group in groups)]
        for name in PREDICTORS
    ]
    words = ("looked at", "aside", "same LiDARs, looked at", "same LiDARs, aside")
    heads = [head_of(target) for target in TARGETS]
    sizes = [f"{len(own.rigs)} {word}" for word, own in zip(words, groups, strict=True)]
    return table(["", *(f"{head}, {size}" for head in heads for size in sizes)], rows)


def errors_table(seen: RigResults, aside: RigResults) -> str:
    """What rigs set aside would reach, by a straight line through those looked at: errors.

    Mean absolute, in points; the first row takes the mean of those looked at for all.
    """
    rows = [["the mean of all looked at"], *([label(name)] for name in FORETOLD)]
    for target in TARGETS:
        y, new = seen.means(target), aside.means(target)
        rows[0].append(number(float((new - y.mean()).abs().mean()), 1))
        wide = every_predictor(SHORT[target])
        for row, name in zip(rows[1:], FORETOLD, strict=True):
            row.append(number(_error(wide[name], y, new), 1))
    return table(["", *(head_of(target) for target in TARGETS)], rows)


def _error(x: pd.Series, y: pd.Series, new: pd.Series) -> float:
    # Theil and Sen's line: one rig that collapses does not turn it.
    line = stats.theilslopes(y, x.loc[y.index])
    said = line.intercept + line.slope * x.loc[new.index]
    return float((new - said).abs().mean())


def _rho(group: RigResults, name: str, target: str) -> float:
    wide, y = every_predictor(SHORT[target]), group.means(target)
    if name not in wide.columns:
        return float("nan")
    return float(np.asarray(stats.spearmanr(wide[name].loc[y.index], y).statistic))

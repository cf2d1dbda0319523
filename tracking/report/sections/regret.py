"""The section of what it costs to take the placement that a surrogate says is best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lidarplace.base.metrics import headline_metric
from lidarplace.pog.surrogates.table import DECIDING, HEADLINE_SURROGATES
from tracking.findings.best_placement import BestPlacement
from tracking.findings.generalist import JUDGEMENTS
from tracking.findings.groups import Group
from tracking.findings.paired import with_sums
from tracking.findings.regret import regrets
from tracking.findings.summary import surrogates_of
from tracking.kitti_iou import headline_iou
from tracking.numbers import digits, span
from tracking.pages.section import Section
from tracking.pages.tables import METRIC, SURROGATE, Column, Table, numbers, words
from tracking.run_folders.sweep import RunFolder

MOST_CHOICES = 100
"""Rows that the page shows."""
_NOTE = (
    "What is lost by taking the placement that a surrogate ranks first, in points. Below the "
    "highest mean: as measured, which is too much on average, because the highest mean is partly "
    "the luckiest. Expected regret: below the truly best placement, over what seeds and test "
    "objects leave open (the posterior by which the first section says how likely each placement "
    "is to be the best), with 95 %. A surrogate is worth its name if it loses less than a "
    "placement at random does."
)


def regret_section(
    run: RunFolder,
    rankings: Sequence[tuple[Group, Mapping[str, BestPlacement]]],
    surrogates: pd.DataFrame,
) -> Section | None:
    """A table for all groups and classes; None where there is no choice or no surrogate.

    Args:
        rankings: every group with its `headline_ranking`.
        surrogates: `tracking.findings.generalist.with_judgements` of the run.
    """
    table = regret_table(run, rankings, surrogates)
    if table.empty:
        return None

    def expected(row: Mapping[Any, Any]) -> str:
        if np.isnan(row["regret"]):
            return "–"
        return f"{digits(row['regret'], 'z.1f')} ({span(row['low'], row['high'], 'z.1f')})"

    columns = [
        words("class"),
        *([words("detector", "group")] if table["group"].nunique() > 1 else []),
        METRIC,
        SURROGATE,
        words("takes the", "takes"),
        words("choice"),
        numbers("below the highest mean (points)", "behind", "z.1f"),
        Column("expected regret (points)", expected),
    ]
    shown = Table.of(
        "What the choice of each surrogate loses",
        table,
        columns,
        name="regret",
        units=dict.fromkeys(("behind", "regret", "low", "high"), "points"),
    ).first(MOST_CHOICES)
    return Section("What does it cost to follow a surrogate?", [_NOTE], tables=[shown])


def regret_table(
    run: RunFolder,
    rankings: Sequence[tuple[Group, Mapping[str, BestPlacement]]],
    surrogates: pd.DataFrame,
) -> pd.DataFrame:
    """`regrets` of every group and class in rows, with class, group, its place, metric and IoU.

    Where no placement is better than another nothing can be lost.
    """
    summed, parts = with_sums(surrogates, run.axes), []
    for group, ranked in rankings:
        for name, best in ranked.items():
            own = surrogates_of(summed, group.place, name)
            # With a first choice of their own, which covered entropy has: the opposite of S-MIG's.
            choose = dict.fromkeys((*JUDGEMENTS, *DECIDING, *HEADLINE_SURROGATES))
            named = [s for s in choose if s in own.columns]
            if not named or len(best.equal) == len(best.sure):
                continue
            place = {"class": name, "group": group.title, **group.place}
            place |= {"metric": headline_metric(name), "iou": headline_iou(run.results, name)}
            found = regrets(best, own[named])
            parts.append(pd.DataFrame([place] * len(found)).join(found))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()

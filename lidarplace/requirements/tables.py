"""Requirements as rows of tables: where each is asked, and what it finds in every case."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

if TYPE_CHECKING:  # who reads tables needs no rays
    from lidarplace.requirements.judge import Finding, Outcome
    from lidarplace.requirements.layout import Laid


def extents(laid: Iterable[Laid]) -> list[dict[str, str | int]]:
    """What each asks of a rig: requirement, measure, positions, and objects that are placed."""
    return [
        {
            "requirement": own.requirement.name,
            "measure": own.requirement.measure,
            "positions": int(own.positions.held.sum()),
            "objects": int(np.isfinite(own.boxes[:, :, 0]).sum()),
        }
        for own in laid
    ]


def case_row(outcome: Outcome, finding: Finding) -> dict[str, object]:
    """What a requirement finds in one case; `short_by` is 0 where it is met, heading None if none.

    Of `met`, every case of a requirement is needed.
    """
    wanted = outcome.requirement
    return {
        "case": finding.case,
        "met": finding.value >= wanted.least,
        "value": finding.value,
        "short_by": max(0.0, wanted.least - finding.value),
        "enough": finding.enough,
        "x": finding.x,
        "y": finding.y,
        "heading_deg": None if finding.heading is None else math.degrees(finding.heading),
        "at_worst": finding.at_worst,
    }


def case_table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """A row for each requirement of a rig and case, as built first: what is asked, `case_row`."""
    rows = [
        {
            "requirement": outcome.requirement.name,
            "measure": outcome.requirement.measure,
            "at_least": outcome.requirement.least,
            "for": outcome.requirement.share,
            **case_row(outcome, finding),
        }
        for outcome in outcomes
        for finding in outcome.findings
    ]
    return pd.DataFrame(rows).astype({"heading_deg": np.float64})


def by_rig(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Tables of `case_table` under each other, the name of each rig in front."""
    return pd.concat(tables, names=["rig"]).reset_index("rig").reset_index(drop=True)


def worst_cases(cases: pd.DataFrame, rig: Sequence[str]) -> pd.DataFrame:
    """Of each requirement of each rig the case with the least value, of equal ones the first.

    Args:
        cases: rows of `case_table`.
        rig: columns that tell rigs apart.
    """
    keys = [*rig, "requirement"]
    least = cases.groupby(keys, sort=False, dropna=False, observed=True)["value"].idxmin()
    return cases.loc[least].reset_index(drop=True)

"""What became of requirements: as tables, and on the ground around the vehicle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lidarplace.requirements.check_requirements import CaseResult, RequirementResult
    from lidarplace.requirements.layout import RequirementLayout

MOST_CELLS = 160  # along an axis; of more positions a cell shows the worst one


@dataclass(frozen=True, eq=False)
class Ground:
    """A grid of cells; `least` is of all cases and of all positions in a cell, in the requirement's
    measure."""

    x: NDArray[np.float64]  # middles of the cells, metres, shape (nx,)
    y: NDArray[np.float64]  # the same, shape (ny,)
    least: NDArray[np.float64]  # NaN where nothing is asked, shape (nx, ny)

    @classmethod
    def of(cls, outcome: RequirementResult) -> Ground:
        """That of a requirement under one rig."""
        positions = outcome.positions
        if not positions.held.size:  # a common view is nowhere
            return cls(positions.x, positions.y, np.empty((0, 0)))
        least = np.full(positions.held.shape, np.nan)
        least[positions.held] = np.where(np.isfinite(outcome.least_of), outcome.least_of, np.nan)
        middles = []
        for axis, line in enumerate((positions.x, positions.y)):
            step = -(-len(line) // MOST_CELLS)
            starts = np.arange(0, len(line), step)
            least = np.fmin.reduceat(least, starts, axis=axis)
            middles.append(np.add.reduceat(line, starts) / np.diff(np.append(starts, len(line))))
        return cls(middles[0], middles[1], least)


def extents(laid: Iterable[RequirementLayout]) -> list[dict[str, str | int]]:
    """What each asks of a rig: requirement, measure, positions, and objects that are placed."""
    return [
        {
            "requirement": own.requirement.name,
            "measure": own.requirement.measured,
            "positions": int(own.positions.held.sum()),
            "objects": int(np.isfinite(own.boxes[:, :, 0]).sum()),
        }
        for own in laid
    ]


def case_row(outcome: RequirementResult, finding: CaseResult) -> dict[str, object]:
    """What a requirement finds in one case; place and heading are None where there is none,
    `short_by` is 0 where it is met."""
    wanted = outcome.requirement
    return {
        "case": finding.case,
        "met": finding.value >= wanted.least,
        "value": finding.value,
        "short_by": max(0.0, wanted.least - finding.value),
        "enough": finding.enough,
        "x": None if math.isnan(finding.x) else finding.x,
        "y": None if math.isnan(finding.y) else finding.y,
        "heading_deg": None if finding.heading is None else math.degrees(finding.heading),
        "at_worst": finding.at_worst,
    }


def case_table(outcomes: Sequence[RequirementResult]) -> pd.DataFrame:
    """A row for each requirement of a rig and case, as built first: what is asked, `case_row`."""
    rows = [
        {
            "requirement": outcome.requirement.name,
            "measure": outcome.requirement.measured,
            "at_least": outcome.requirement.least,
            "for": outcome.requirement.share,
            **case_row(outcome, finding),
        }
        for outcome in outcomes
        for finding in outcome.findings
    ]
    return pd.DataFrame(rows).astype(dict.fromkeys(("x", "y", "heading_deg"), np.float64))


def by_rig(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Tables of `case_table` under each other, the name of each rig in front."""
    return pd.concat(tables, names=["rig"]).reset_index("rig").reset_index(drop=True)


def worst_cases(cases: pd.DataFrame, rig: Sequence[str]) -> pd.DataFrame:
    """Of each requirement of each rig, known by the columns `rig`, the case with the least value,
    of equal ones the first; `cases` are rows of `case_table`."""
    keys = [*rig, "requirement"]
    least = cases.groupby(keys, sort=False, dropna=False, observed=True)["value"].idxmin()
    return cases.loc[least].reset_index(drop=True)

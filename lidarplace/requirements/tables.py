"""Results of requirements as tables, and on the ground around the vehicle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lidarplace.requirements.check_requirements import CaseResult, RequirementResult
    from lidarplace.requirements.layout import RequirementLayout

MOST_CELLS = 160  # along an axis; of more positions a cell shows the worst one


@dataclass(frozen=True, eq=False)
class Ground:
    """A grid of cells with the least value of a requirement in each.

    `least` is of all cases and of all positions in a cell, in the requirement's measure."""

    x: NDArray[np.float64]  # middles of the cells, metres, shape (nx,)
    y: NDArray[np.float64]  # the same, shape (ny,)
    least: NDArray[np.float64]  # NaN where nothing is asked, shape (nx, ny)

    @classmethod
    def of(cls, result: RequirementResult) -> Ground:
        """Return the ground of a requirement under one rig."""
        positions = result.positions
        if not positions.held.size:  # a common view is nowhere
            return cls(positions.x, positions.y, np.empty((0, 0)))
        least = np.full(positions.held.shape, np.nan)
        least[positions.held] = np.where(np.isfinite(result.least_of), result.least_of, np.nan)
        middles = []
        for axis, line in enumerate((positions.x, positions.y)):
            step = -(-len(line) // MOST_CELLS)
            starts = np.arange(0, len(line), step)
            least = np.fmin.reduceat(least, starts, axis=axis)
            middles.append(np.add.reduceat(line, starts) / np.diff(np.append(starts, len(line))))
        return cls(middles[0], middles[1], least)


def extents(layouts: Iterable[RequirementLayout]) -> list[dict[str, str | int]]:
    """Return what each requirement asks: its name, measure, positions and placed objects."""
    return [
        {
            "requirement": layout.requirement.name,
            "measure": layout.requirement.measured,
            "positions": int(layout.positions.held.sum()),
            "objects": int(np.isfinite(layout.boxes[:, :, 0]).sum()),
        }
        for layout in layouts
    ]


def case_row(result: RequirementResult, case: CaseResult) -> dict[str, object]:
    """Return the result of a requirement in one case as a row.

    Place and heading are None where there is none, `short_by` is 0 where it is met, `undecided`
    where the verdict is sure."""
    requirement = result.requirement
    return {
        "case": case.case,
        "met": case.value >= requirement.least,
        "value": case.value,
        "short_by": max(0.0, requirement.least - case.value),
        "enough": case.enough,
        "undecided": case.undecided,
        "x": None if math.isnan(case.x) else case.x,
        "y": None if math.isnan(case.y) else case.y,
        "heading_deg": None if case.heading is None else math.degrees(case.heading),
        "at_worst": case.at_worst,
    }


def verdict(row: Mapping[Any, Any]) -> str:
    """Return the verdict of a row of `case_table`."""
    if not row["undecided"]:
        return "pass" if row["met"] else "FAIL"
    unit = "%" if row["for"] == 1.0 else "points"
    return f"within {100 * row['undecided']:.2g} {unit}: finer positions decide"


def case_table(results: Sequence[RequirementResult]) -> pd.DataFrame:
    """Return a row for each requirement of a rig and case, as built first; see `case_row`."""
    rows = [
        {
            "requirement": result.requirement.name,
            "measure": result.requirement.measured,
            "at_least": result.requirement.least,
            "for": result.requirement.share,
            **case_row(result, case),
        }
        for result in results
        for case in result.cases
    ]
    return pd.DataFrame(rows).astype(dict.fromkeys(("x", "y", "heading_deg"), np.float64))


def by_rig(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return tables of `case_table` under each other, the name of each rig in front."""
    return pd.concat(tables, names=["rig"]).reset_index("rig").reset_index(drop=True)


def worst_cases(cases: pd.DataFrame, rig: Sequence[str]) -> pd.DataFrame:
    """Return the case with the least value of each requirement and rig, ties to the first.

    A case that surely fails comes before the others.
    `cases` are rows of `case_table`, rigs are identified by the columns `rig`."""
    keys = [*rig, "requirement"]
    fails = ~cases["met"] & (cases["undecided"] == 0)
    order = cases.assign(_open=~fails).sort_values(["_open", "value"], kind="stable").index
    groups = cases.groupby(keys, sort=False, dropna=False, observed=True).ngroup()
    first = groups[order].drop_duplicates().sort_values().index
    return cases.loc[first].reset_index(drop=True)

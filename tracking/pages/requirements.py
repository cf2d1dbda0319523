"""Requirements on pages: which rig meets which, and the ground where one fails."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from lidarplace.rigs.placement import Mount
from tracking.figures.of_rigs.requirement_map import requirement_map
from tracking.numbers import digits
from tracking.pages.section import Section
from tracking.pages.tables import Column, Table, words
from tracking.run_folders.grounds import Grounds

ALONE = (
    "An object stands alone on level ground at each position, in the worst of its headings; what "
    "hides it is the body of the vehicle, and its other LiDARs where their size is known."
)
COLOURS = (
    "What is at each position, in the worst of all cases, in terms of what is needed: orange is "
    "too little, blue is enough. The cross is the worst place; diamonds are LiDARs."
)
MOST_DRAWN = 12
"""Of what fails."""


def counted(worst: pd.DataFrame) -> str:
    """How many verdicts are failures, a sentence."""
    failed = int((~worst["met"]).sum())
    return f"{failed} of {len(worst)} verdicts are failures."


def verdict_table(worst: pd.DataFrame, rig: Sequence[str], **further: Any) -> Table:
    """A row for each of `worst_cases`, what fails is stressed; `further` attributes as they are.

    Args:
        rig: columns that tell rigs apart.
    """
    columns = [
        *(words(name) for name in rig),
        words("requirement"),
        Column("verdict", lambda row: "pass" if row["met"] else "FAIL", words=True),
        Column("needed", _needed),
        Column("found", lambda row: f"{row['value']:.4g}"),
        Column("short by", lambda row: f"{row['short_by']:.4g}" if row["short_by"] > 0 else ""),
        Column("enough at", lambda row: f"{100 * row['enough']:.4g} %"),
        Column("worst place", _place, words=True),
        words("when", "case"),
    ]
    failed = frozenset((i, len(rig) + 1) for i, met in enumerate(worst["met"]) if not met)
    return Table.of("Each in its worst case", worst, columns, best=failed, **further)


def _needed(row: Mapping[Any, Any]) -> str:
    share = "" if row["for"] == 1.0 else f", {100 * row['for']:g} %"
    return f"{row['at_least']:g} {row['measure']}{share}"


def _place(row: Mapping[Any, Any]) -> str:
    heading = "" if math.isnan(row["heading_deg"]) else f", {row['heading_deg']:.0f}°"
    return f"x {digits(row['x'], 'z.2f')}, y {digits(row['y'], 'z.2f')}{heading}"


def in_short(row: Mapping[Any, Any]) -> str:
    """A verdict in a cell: what is there of what is needed."""
    verdict = "pass" if row["met"] else "FAIL"
    said = f"{verdict}: {row['value']:.3g} of {_needed(row)}"
    return said if row["met"] else f"{said}; {row['case']}, {_place(row)}"


def draw_failures(
    section: Section,
    worst: pd.DataFrame,
    rig: str,
    order: Iterable[str],
    mounts: Mapping[str, Sequence[Mount]],
    grounds: Grounds | None,
) -> None:
    """Add pictures of what rigs fail, as far as their grounds are kept, and say what they show.

    Args:
        worst: rows of `lidarplace.requirements.tables.worst_cases`.
        rig: column that tells rigs apart.
        order: rigs, those to draw first in front; `mounts` by their names.
    """
    failing = [
        (name, row, ground)
        for name in order
        for row in worst[(worst[rig] == name) & ~worst["met"]].to_dict("records")
        if grounds is not None and (ground := grounds.under(name, row["requirement"])) is not None
    ]
    if grounds is None or not failing:
        return
    section.figures += [
        requirement_map(row, ground, name, mounts[name], grounds.body)
        for name, row, ground in failing[:MOST_DRAWN]
    ]
    section.notes.append(COLOURS)
    if len(failing) > MOST_DRAWN:
        section.notes.append(f"The first {MOST_DRAWN} of {len(failing)} failures are drawn.")

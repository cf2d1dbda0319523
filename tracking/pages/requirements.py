"""Requirements on pages: which rig meets which, and the ground where one fails."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.number_text import number
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.tables import Ground, verdict
from lidarplace.rigs.placement import Mount
from tracking.figures.kit.site_lines import site_from_above
from tracking.figures.kit.style import TOLD, figure, lidar_markers, text
from tracking.figures.kit.vehicle_lines import (
    VEHICLE_OUTLINE,
    axes_from_above,
    has_body,
    map_height,
)
from tracking.labels import digits
from tracking.pages.section import Column, Section, Table, words
from tracking.run_folders.arrays import Grounds

COLOURS = (
    "The value at each position, in the worst case, relative to the requirement: orange is "
    "too little, blue is enough. The cross is the worst place; diamonds are LiDARs."
)
MOST_DRAWN = 12
_ENOUGH = 0.5
_COLOURS = ((0.0, "#7a2b00"), (_ENOUGH, "#f0a070"), (_ENOUGH, "#a8d4f0"), (1.0, "#15619f"))
"""Colours of the share of the need: orange is too little, darker the less; blue is enough."""


def alone(vehicle: Vehicle | None) -> str:
    """Explain what stands at each position, and what occludes it."""
    hides = "the body of the vehicle occludes"
    if not has_body(vehicle):
        hides = "buildings and keep-outs occlude"
    return (
        f"Each position has a single object on level ground, at its worst heading. Only {hides} "
        "it, and the other LiDARs if their size is known."
    )


def counted(worst: pd.DataFrame) -> str:
    """Count the verdicts that are failures, and those that are open, in words."""
    is_open = int((worst["undecided"] > 0).sum())
    failed = int((~worst["met"]).sum()) - is_open
    return f"Failed verdicts: {failed} of {len(worst)}{f'; open: {is_open}' * (is_open > 0)}."


def verdict_table(worst: pd.DataFrame, rig: Sequence[str], **further: Any) -> Table:
    """Make a row for each of `worst_cases`; what fails is stressed.

    `rig` are columns that distinguish rigs, `further` are attributes of the table."""
    columns = [
        *(words(name) for name in rig),
        words("requirement"),
        Column("verdict", verdict, words=True),
        Column("needed", _needed),
        Column("found", lambda row: number(row["value"], 4 if row["value"] >= 1000 else 3)),
        Column("short by", lambda row: number(row["short_by"], 3) if row["short_by"] > 0 else ""),
        Column("enough at", lambda row: f"{100 * row['enough']:.3g} %"),
        Column("worst place", _place, words=True),
        words("when", "case"),
    ]
    failed = frozenset((i, len(rig) + 1) for i, met in enumerate(worst["met"]) if not met)
    return Table.of("Each in its worst case", worst, columns, best=failed, **further)


def _needed(row: Mapping[Any, Any]) -> str:
    share = "" if row["for"] == 1.0 else f", {100 * row['for']:g} %"
    return f"{row['at_least']:g} {row['measure']}{share}"


def _place(row: Mapping[Any, Any]) -> str:
    if math.isnan(row["x"]):
        return ""
    heading = "" if math.isnan(row["heading_deg"]) else f", {row['heading_deg']:.0f}°"
    return f"x {digits(row['x'], 'z.2f')}, y {digits(row['y'], 'z.2f')}{heading}"


def in_short(row: Mapping[Any, Any]) -> str:
    """Format a verdict in a cell: the value relative to what is needed."""
    short = f"{verdict(row)}: {number(row['value'], 3)} of {_needed(row)}"
    if row["met"]:
        return short
    return "; ".join([short, ", ".join(filter(None, [row["case"], _place(row)]))])


def draw_verdicts(
    section: Section,
    worst: pd.DataFrame,
    rig: str,
    order: Iterable[str],
    mounts: Mapping[str, Sequence[Mount]],
    grounds: Grounds | None,
    vehicle: Vehicle | None,
) -> None:
    """Add pictures of all that the first rig passes and fails, then of what others fail.

    `worst` are rows of `lidarplace.requirements.tables.worst_cases`, `rig` is the column that
    distinguishes rigs, `order` has the rigs to draw first in front, `mounts` are by rig. There are
    pictures as far as `grounds` are kept; notes say what they show. What is around
    a site, the `vehicle`, is drawn."""
    if grounds is None:
        return
    drawn = [
        (name, row, ground)
        for number, name in enumerate(order)
        for row in worst[(worst[rig] == name)].sort_values("met", kind="stable").to_dict("records")
        if (number == 0 or not row["met"])
        and (ground := grounds.under(name, row["requirement"])) is not None
        and ground.least.size
    ]
    section.figures += [
        requirement_map(row, ground, name, mounts[name], grounds.body, vehicle)
        for name, row, ground in drawn[:MOST_DRAWN]
    ]
    section.notes += [COLOURS] if drawn else []
    if len(drawn) > MOST_DRAWN:
        section.notes.append(f"The first {MOST_DRAWN} of {len(drawn)} pictures are shown.")


def requirement_map(
    worst: Mapping[Any, Any],
    ground: Ground,
    rig: str,
    mounts: Sequence[Mount],
    body: NDArray[np.float64],
    vehicle: Vehicle | None = None,
) -> go.Figure:
    """Draw the value of every place relative to its need, in the worst of all cases.

    The colours end at nothing and at twice the need. A cross marks the worst position of the case
    `worst`, a row of `lidarplace.requirements.tables.worst_cases`. `body` is
    `lidarplace.mounting.outline.outline` of the vehicle; around a site lanes and buildings are
    drawn."""
    needed, measure = float(worst["at_least"]), worst["measure"]
    x, y, least = ground.x, ground.y, ground.least.astype(np.float64)
    title = f"{text(rig)} · {text(worst['requirement'])}: {verdict(worst)}"
    plot = figure(title, height=map_height((np.ptp(y) + 2.0) / (np.ptp(x) + 4.0), 220, 560))
    bar = {"title": {"text": "of need"}, "tickvals": [0, 1, 2], "ticktext": ["0", "1", "≥ 2"]}
    of_need = f"%{{customdata:.3g}} {measure} of {needed:g}"
    plot.add_heatmap(
        x=x,
        y=y,
        z=np.clip(least.T / needed, 0.0, 2.0).astype(np.float32),
        customdata=least.T.astype(np.float32),
        zmin=0.0,
        zmax=2.0,
        colorscale=_COLOURS,
        colorbar={**bar, "thickness": 10, "x": 1.03, "len": 1.0},
        hovertemplate=f"x %{{x:.2f}}, y %{{y:.2f}} m<br>{of_need}<extra></extra>",
        hoverongaps=False,
    )
    plot.add_traces(site_from_above(vehicle))
    plot.add_scatter(x=body[:, 0], y=body[:, 1], **VEHICLE_OUTLINE)
    plot.add_scatter(
        x=[mount.x for mount in mounts],
        y=[mount.y for mount in mounts],
        mode="markers",
        marker=lidar_markers(len(mounts), 8),
        hovertext=[f"LiDAR {number + 1}, {mount.z:g} m up" for number, mount in enumerate(mounts)],
        **TOLD,
    )
    edge = {"color": "#000000", "width": 1.5}
    plot.add_scatter(
        x=[worst["x"]],
        y=[worst["y"]],
        mode="markers",
        marker={"symbol": "x", "size": 11, "color": "#ffffff", "line": edge},
        hovertext=f"worst: {worst['at_worst']:.3g} {measure}, {text(worst['case'])}",
        **TOLD,
    )
    reach = np.concatenate([body, [[x[0], y[0]], [x[-1], y[-1]]]])
    (x0, y0), (x1, y1) = np.nanmin(reach, axis=0) - 0.3, np.nanmax(reach, axis=0) + 0.3
    return axes_from_above(plot, [x0, x1], [y0, y1])

"""What one detector for all placements says, against the placements' own detectors."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.placement_points import add_placements
from tracking.figures.kit.style import OUTLINE, figure, text
from tracking.labels import metric_label
from tracking.numbers import interval, signed


def against_generalist(
    pairs: pd.DataFrame, row: Mapping[Hashable, Any], title: str, placements: Sequence[str]
) -> go.Figure:
    """A point a placement with 95 % intervals for a comparison.

    On the line the generalist is off by its bias alone. Equal values may be far from all points.

    Args:
        pairs: `tracking.findings.generalist.side_by_side`.
        row: of `tracking.findings.generalist.compare`.
        title: plotly text.
        placements: all of the sweep, in order, so that a placement keeps its colour.
    """
    said = str(row["note"])
    if np.isfinite(row["spearman"]):
        span = interval(row["spearman_low"], row["spearman_high"])
        said = f"ρ = {signed(row['spearman'])} {span}, n = {row['n']}"
    if np.isfinite(row["ceiling"]):
        said += f", ceiling {row['ceiling']:.2f}"
    shown = f'<br><span style="font-size:12px">{text(said)}</span>'
    plot = figure(title + shown, height=400, margin={"t": 64})
    table = pairs.loc[[name for name in placements if name in pairs.index]]
    names = [str(name) for name in table.index]
    x, y = (table[key].to_numpy(np.float64) for key in ("said", "own"))
    ends = np.array([x.min(), x.max()])
    plot.add_scatter(
        x=ends,
        y=ends - row["bias"],
        mode="lines",
        line={"color": OUTLINE, "width": 1, "dash": "dot"},
        hoverinfo="skip",
        showlegend=False,
    )
    add_placements(
        plot,
        x,
        y,
        table["own_half"],
        names,
        placements,
        table["said_half"],
        hovertemplate="%{text}<br>generalist %{x:.2f} %<br>own detectors %{y:.2f} %<extra></extra>",
    )
    label = metric_label(row["metric"], row["iou"])
    plot.update_xaxes(title=f"{label} by the generalist (%)")
    plot.update_yaxes(title=f"{label} by own detectors (%)")
    return plot

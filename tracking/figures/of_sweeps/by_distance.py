"""Lines of placements over the distance of the objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import colour, error_bars, figure, symbol, text

_SPREAD = 0.35  # of a ring's width, over which the markers of placements are set apart


def ring_label(low: float, high: float) -> str:
    """For example "10–20", "50+"."""
    return f"{low:g}–{high:g}" if np.isfinite(high) else f"{low:g}+"


def by_distance(
    table: pd.DataFrame, title: str, axis: str, placements: Sequence[str], log: bool = False
) -> go.Figure:
    """A line a placement, its colour that of the whole page; bars are intervals.

    Args:
        table: placement, from_m, to_m, value, number of `objects`, and `low` and `high`, missing
            where there is no interval.
        title: plotly text.
        axis: what `value` is, with its unit.
        placements: all of the sweep, in order, so that a placement keeps its colour.
        log: a logarithmic axis; zeros are not drawn.
    """
    plot = figure(title, height=400)
    rings = sorted(set(zip(table["from_m"], table["to_m"], strict=True)))
    number = {ring: i for i, ring in enumerate(rings)}
    shown = [name for name in placements if name in set(table["placement"])]
    for place, name in enumerate(shown):
        own = table[table["placement"] == name].sort_values("from_m")
        offset = _SPREAD * ((place + 0.5) / len(shown) - 0.5)
        rank = placements.index(name)
        x = [number[ring] + offset for ring in zip(own["from_m"], own["to_m"], strict=True)]
        value = own["value"].to_numpy(np.float64)
        plot.add_scatter(
            x=x,
            y=value,
            error_y=error_bars(own["high"] - value, value - own["low"], thickness=1, width=2)
            if own["low"].notna().any()
            else None,
            mode="lines+markers",
            line={"color": colour(rank), "width": 1.5},
            marker={"size": 6, "symbol": symbol(rank)},
            name=text(name),
            customdata=[ring_label(*ring) for ring in zip(own["from_m"], own["to_m"], strict=True)],
            text=[f"{count:,}" for count in own["objects"]],
            hovertemplate=f"{text(name)}<br>%{{customdata}} m, %{{text}} objects<br>"
            "%{y:.4g}<extra></extra>",
        )
    plot.update_xaxes(
        title="distance of the object (m)",
        tickvals=list(range(len(rings))),
        ticktext=[ring_label(*ring) for ring in rings],
        range=[-0.5, len(rings) - 0.5],
    )
    plot.update_yaxes(title=axis)
    if log:
        # Whole numbers: plotly's own are single digits between powers of ten.
        ticks = [digit * 10.0**power for power in range(-2, 7) for digit in (1, 2, 5)]
        plot.update_yaxes(type="log", tickvals=ticks, ticktext=[f"{tick:,g}" for tick in ticks])
    plot.update_layout(legend={"orientation": "h", "y": -0.2})
    return plot

"""AP or recall against traffic density, a line a placement."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import colour, error_bars, figure, legend_below, symbol, text

MOST_LINES = 12


def by_density(
    means: pd.DataFrame, axis: str, title: str, label: str, placements: Sequence[str]
) -> go.Figure:
    """A line a placement with 95 % intervals, moved apart a little.

    Args:
        means: rows of `seed_means` for one class, detector and metric.
        axis: the column of the density, vehicles in the town.
        title: plotly text.
        label: of the metric, with its unit.
        placements: all of the sweep, in order, so that a placement keeps its colour; the first
            `MOST_LINES` with a value are drawn.
    """
    plot = figure(title, height=420)
    known = set(means.loc[means["seeds"] > 0, "placement"])
    shown = [name for name in placements if name in known][:MOST_LINES]
    values = sorted(means[axis].unique())
    apart = 0.012 * (values[-1] - values[0])
    for i, name in enumerate(shown):
        own = means[means["placement"] == name].sort_values(axis)
        rank = list(placements).index(name)
        plot.add_scatter(
            x=(own[axis] + apart * (i - (len(shown) - 1) / 2)).to_numpy(),
            y=own["mean"].to_numpy(),
            error_y=error_bars((own["high"] - own["mean"]).fillna(0), thickness=1, width=2),
            mode="lines+markers",
            line={"color": colour(rank), "width": 1.5},
            marker={"size": 8, "symbol": symbol(rank)},
            name=text(name),
            customdata=own[axis].to_numpy(),
            hovertemplate="density %{customdata}: %{y:.1f} %<extra>%{fullData.name}</extra>",
        )
    plot.update_xaxes(title="density (vehicles in the town)", tickvals=values)
    plot.update_yaxes(title=label)
    legend_below(plot)
    return plot

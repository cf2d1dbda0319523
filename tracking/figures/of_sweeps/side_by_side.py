"""The same rows under several columns: placements by metric, pairs of placements by detector."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import (
    OUTLINE,
    add_odds,
    colour,
    error_bars,
    figure,
    legend_below,
    name_rows,
    symbol,
    text,
)

MOST_ROWS = 20


def side_by_side(
    columns: Mapping[str, pd.DataFrame],
    rows: Sequence[str],
    title: str,
    axis: str,
    odds: Sequence[str] = (),
) -> go.Figure:
    """Points in rows, a colour a column, bars for 95 % intervals.

    Args:
        columns: by name, mean, low and high (NaN for no interval) by row.
        rows: in the order from top to bottom; the first `MOST_ROWS` are drawn.
        odds: how likely each row is to be the best, written on the right.
    """
    shown = list(rows)[:MOST_ROWS]
    plot = figure(title, height=150 + (24 + 8 * len(columns)) * len(shown))
    for i, (name, own) in enumerate(columns.items()):
        own = own.reindex(shown)
        # One below the other within a row, as bars of equal values would hide each other.
        place = np.arange(len(shown)) + 0.5 * ((i + 0.5) / len(columns) - 0.5)
        plot.add_scatter(
            x=own["mean"].to_numpy(),
            y=place,
            error_x=error_bars((own["high"] - own["mean"]).fillna(0), thickness=1.5),
            mode="markers",
            marker={"size": 9, "color": colour(i), "symbol": symbol(i)},
            name=text(name),
            customdata=[text(row) for row in shown],
            hovertemplate="%{customdata}: %{x:.1f}<extra>%{fullData.name}</extra>",
            showlegend=True,
        )
    plot.update_xaxes(title=text(axis))
    name_rows(plot, shown)
    if odds:
        add_odds(plot, odds[:MOST_ROWS])
    legend_below(plot)
    return plot


def differences_figure(differences: pd.DataFrame, title: str, axis: str) -> go.Figure:
    """A row a pair, a colour a detector, bars for intervals; the dotted line is no difference.

    Args:
        differences: pair, detector, difference, low, high (NaN for no interval).
    """
    columns = {
        str(detector): own.set_index("pair").rename(columns={"difference": "mean"})
        for detector, own in differences.groupby("detector", sort=False)
    }
    plot = side_by_side(columns, list(dict.fromkeys(differences["pair"])), title, axis)
    plot.add_vline(x=0, line={"color": OUTLINE, "dash": "dot", "width": 1.5})
    return plot

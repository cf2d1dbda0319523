"""Means of placements with their intervals, the best on top."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.odds import add_odds
from tracking.figures.kit.placement_points import placement_markers
from tracking.figures.kit.style import OUTLINE, error_bars, figure, text

_ROW = 26  # pixels


def forest(table: pd.DataFrame, title: str, axis: str, placements: Sequence[str]) -> go.Figure:
    """A row a placement: mean, interval, and on the right how sure it is that it is the best.

    Args:
        table: index placement, the best first; `mean`; `low` and `high` of it, and `half` the
            interval of a comparison, missing where there is none; and `sure`, text.
        title: plotly text.
        axis: what the mean is of, with its unit.
        placements: all of the sweep, in order, so that a placement keeps its colour.
    """
    names = [str(name) for name in table.index]
    plot = figure(title, height=130 + _ROW * len(names))
    rows = list(range(len(names)))
    mean, half = table["mean"], table["half"].fillna(0)
    # No percentage is beyond 0 and 100, whatever a symmetric interval says.
    up, down = half.clip(upper=100 - mean), half.clip(upper=mean)
    above, below = (table["high"].clip(upper=100) - mean), mean - table["low"].clip(lower=0)
    if (above > up).any() or (below > down).any():
        plot.add_scatter(
            x=mean.to_numpy(),
            y=rows,
            error_x=error_bars(above, below, thickness=1, width=0, color=OUTLINE),
            mode="markers",
            marker={"size": 1, "color": OUTLINE},
            hoverinfo="skip",
            showlegend=False,
        )
    plot.add_scatter(
        x=mean.to_numpy(),
        y=rows,
        error_x=error_bars(up, down, thickness=3, width=4, color=OUTLINE),
        mode="markers",
        marker=placement_markers(names, placements),
        text=[text(name) for name in names],
        hovertemplate="%{text}<br>%{x:.2f} %<extra></extra>",
        showlegend=False,
    )
    plot.update_xaxes(title=axis)
    plot.update_yaxes(
        tickvals=rows,
        ticktext=[text(name) for name in names],
        showgrid=False,
    )
    add_odds(plot, list(table["sure"]))
    return plot

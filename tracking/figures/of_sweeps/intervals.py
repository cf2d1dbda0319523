"""Surrogates of the placements with the sampling error of the POG: a forest plot."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import add_menu, colour, error_bars, figure, text
from tracking.labels import in_order, surrogate_label, surrogate_name


def intervals(estimates: pd.DataFrame, title: str, placements: Sequence[str]) -> go.Figure:
    """A row a placement: its interval, and the value of the log as a hollow point.

    Args:
        estimates: of one class: placement, surrogate, value, low, high.
        placements: in the order from top to bottom.
    """
    plot = figure(text(title), height=120 + 34 * len(placements), margin={"t": 72})
    names = in_order(estimates["surrogate"])
    first = "expected_ig" if "expected_ig" in names else names[0]
    for name in names:
        own = estimates[estimates["surrogate"] == name].set_index("placement")
        own = own.reindex([p for p in placements if p in own.index])
        middle = (own["low"] + own["high"]) / 2
        labels = [text(placement) for placement in own.index]
        plot.add_scatter(
            x=middle.to_numpy(),
            y=labels,
            error_x=error_bars(own["high"] - middle, thickness=2),
            mode="markers",
            marker={"size": 9, "color": colour(0)},
            name="estimate, bias taken off",
            visible=name == first,
            hovertemplate="%{y}: %{x:,.5g}<extra></extra>",
        )
        plot.add_scatter(
            x=own["value"].to_numpy(),
            y=labels,
            mode="markers",
            marker={"size": 9, "color": colour(5), "symbol": "diamond-open"},
            name="value of this log",
            visible=name == first,
            hovertemplate="%{y}: %{x:,.5g}<extra></extra>",
        )
    plot.update_layout(
        xaxis_title=surrogate_label(first),
        legend={"orientation": "h", "y": 1, "yanchor": "bottom"},
    )
    changes = [
        (
            {"visible": [name == other for other in names for _ in range(2)]},
            {"xaxis.title.text": surrogate_label(name)},
        )
        for name in names
    ]
    labels = [surrogate_name(name) for name in names]
    add_menu(plot, labels, changes, names.index(first), right=True, y=1.02)
    plot.update_yaxes(autorange="reversed")
    return plot

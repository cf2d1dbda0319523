"""How well a placement's metric is predicted from the other placements."""

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import (
    OUTLINE,
    colour,
    figure,
    legend_below,
    symbol,
    text,
    two_lines,
)
from tracking.labels import in_order, surrogate_name


def left_out(errors: pd.DataFrame, title: str) -> go.Figure | None:
    """Error of a line through the other placements over that of their mean, a colour a surrogate.

    Args:
        errors: surrogate, rmse and rmse_of_mean of `tracking.findings.leave_one_out`, and `label`:
            what the row of the figure is called, once for each surrogate.
        title: plotly text.

    Returns:
        None if there is no error at all.
    """
    known = errors[errors["rmse"].notna() & (errors["rmse_of_mean"] > 0)]
    if known.empty:
        return None
    labels = [two_lines(text(label)) for label in dict.fromkeys(known["label"])]
    names = in_order(known["surrogate"])
    plot = figure(title, height=140 + 34 * len(labels))
    for i, name in enumerate(names):
        own = known[known["surrogate"] == name]
        plot.add_scatter(
            x=(own["rmse"] / own["rmse_of_mean"]).to_numpy(),
            y=[two_lines(text(label)) for label in own["label"]],
            mode="markers",
            marker={"size": 10, "color": colour(i), "symbol": symbol(i)},
            name=surrogate_name(name),
            showlegend=True,
            customdata=own["rmse"].to_numpy(),
            hovertemplate="%{y}: %{x:.2f}, %{customdata:.2f} points<extra>%{fullData.name}</extra>",
        )
    plot.add_vline(x=1, line={"color": OUTLINE, "dash": "dot", "width": 1.5})
    plot.update_xaxes(title="error / error of the mean", rangemode="tozero")
    plot.update_yaxes(categoryorder="array", categoryarray=labels[::-1])
    legend_below(plot)
    return plot

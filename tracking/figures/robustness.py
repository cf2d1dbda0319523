"""What is left of a rig's value when a mount is off, a LiDAR fails or the scene is another."""

from __future__ import annotations

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.style import colour, figure, symbol, text


def robustness_figure(rows: pd.DataFrame, title: str) -> go.Figure:
    """A row a case: mean share of the value as designed, in percent; the bar ends at the worst.

    Args:
        rows: rig, case, value, worst and share (value / value as designed) of one objective.
        title: plotly text.
    """
    cases = list(dict.fromkeys(rows["case"]))
    rigs = list(dict.fromkeys(rows["rig"]))
    step = 0.6 / len(rigs)
    plot = figure(title, height=int(150 + (22 + 14 * len(rigs)) * len(cases)))
    for i, rig in enumerate(rigs):
        own = rows[rows["rig"] == rig]
        share = 100 * own["share"].to_numpy(np.float64)
        # What is as designed: the value over its share.
        worst = share * (own["worst"] / own["value"]).to_numpy(np.float64)
        plot.add_scatter(
            x=share,
            y=[cases.index(case) + step * (i - (len(rigs) - 1) / 2) for case in own["case"]],
            error_x={
                "type": "data",
                "symmetric": False,
                "array": np.maximum(worst - share, 0),
                "arrayminus": np.maximum(share - worst, 0),
                "thickness": 1.5,
            },
            mode="markers",
            marker={"size": 9, "color": colour(i), "symbol": symbol(i)},
            text=[text(case) for case in own["case"]],
            hovertemplate="%{text}: %{x:.2f} %<extra>" + text(rig) + "</extra>",
            name=text(rig),
        )
    plot.add_vline(x=100, line={"color": "#888888", "width": 1, "dash": "dot"})
    plot.update_xaxes(title="share of the value as designed (%)")
    plot.update_yaxes(
        tickvals=list(range(len(cases))),
        ticktext=[text(case) for case in cases],
        range=[len(cases) - 0.5, -0.5],
        showgrid=False,
    )
    plot.update_layout(
        legend={"orientation": "h", "y": 1, "yanchor": "bottom"}, margin={"t": 72}, showlegend=True
    )
    return plot

"""What rigs are worth when a mount is off, a LiDAR fails or the scene is another."""

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import colour, error_bars, figure, legend_below, symbol, text
from tracking.run_folders.search_json import Objective


def robustness_figure(
    rows: pd.DataFrame, objective: Objective, reference: str, designed: float
) -> go.Figure:
    """A row a case: the mean, in percent of one value for all rigs; the bar ends at the worst.

    Values are in their own unit where there is no percent: `designed` is not positive.

    Args:
        rows: rig, case, value and worst of one objective.
        reference: the rig whose value as designed is 100 %; designed: that value.
    """
    cases = list(dict.fromkeys(rows["case"]))
    rigs = list(dict.fromkeys(rows["rig"]))
    step = 0.6 / len(rigs)
    relative = designed > 0
    scale, unit = (100 / designed, "%") if relative else (1.0, text(objective.unit))
    height = 126 + (22 + 14 * len(rigs)) * len(cases)
    plot = figure(text(objective.name), height=height)
    for i, rig in enumerate(rigs):
        own = rows[rows["rig"] == rig]
        mean = scale * own["value"].to_numpy(np.float64)
        worst = scale * own["worst"].to_numpy(np.float64)
        plot.add_scatter(
            x=mean,
            y=[cases.index(case) + step * (i - (len(rigs) - 1) / 2) for case in own["case"]],
            error_x=error_bars(
                np.maximum(worst - mean, 0), np.maximum(mean - worst, 0), thickness=1.5
            ),
            mode="markers",
            marker={"size": 9, "color": colour(i), "symbol": symbol(i)},
            text=[text(case) for case in own["case"]],
            hovertemplate="%{text}: %{x:.5~g} " + unit + "<extra>" + text(rig) + "</extra>",
            name=text(rig),
        )
    if relative:
        plot.add_vline(x=100, line={"color": "#888888", "width": 1, "dash": "dot"})
        title = f"percent of {text(reference)} as designed"
    else:
        title = text(objective.label)
    plot.update_xaxes(title=f"{title},<br>{objective.better}")
    plot.update_yaxes(
        tickvals=list(range(len(cases))),
        ticktext=[text(case) for case in cases],
        range=[len(cases) - 0.5, -0.5],
        showgrid=False,
    )
    plot.update_layout(showlegend=True)
    legend_below(plot)
    return plot

"""Did the surrogate's gain become AP: gain against difference of AP, with intervals."""

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.label_places import label_places
from tracking.figures.kit.style import OUTLINE, colour, error_bars, figure, text
from tracking.run_folders.search_json import Objective

_ROLES = {
    "found": ("circle", colour(0)),
    "greedy": ("star", colour(2)),
    "paper": ("diamond", colour(1)),
}


def verified_figure(
    rows: pd.DataFrame, baseline: str, surrogate: float, objective: Objective, label: str
) -> go.Figure:
    """A point a rig, both axes as differences to the baseline, which is at the origin.

    Args:
        rows: of `verified.parquet` for one class, metric and IoU.
        baseline: the rig that the others are compared to.
        surrogate: the baseline's value of `objective`.
        objective: the first one, whose values the column `surrogate` holds.
        label: class and metric, plotly text.
    """
    # The baseline differs by nothing from itself, without error.
    at_origin = ["difference", "difference_low", "difference_high"]
    rows = rows.copy()
    rows.loc[rows["rig"] == baseline, at_origin] = 0.0
    gain = (rows["surrogate"] - surrogate).to_numpy(np.float64)
    unit = objective.unit
    if surrogate > 0:
        gain, unit = 100 * gain / surrogate, "%"
    difference = rows["difference"].to_numpy(np.float64)
    names = [str(name) for name in rows["rig"]]
    plot = figure(label, height=400)
    bars = (rows["difference_high"] - rows["difference_low"]).to_numpy(np.float64) / 2
    places = label_places(gain, difference, names, bars)
    for role, (shape, shade) in _ROLES.items():
        own = (rows["role"] == role).to_numpy()
        if not own.any():
            continue
        plot.add_scatter(
            x=gain[own],
            y=difference[own],
            error_y=error_bars(
                (rows["difference_high"].to_numpy(np.float64) - difference)[own],
                (difference - rows["difference_low"].to_numpy(np.float64))[own],
                thickness=1.5,
                color=OUTLINE,
            ),
            mode="markers+text",
            marker={"size": 10, "symbol": shape, "color": shade},
            text=[text(name) for name, mine in zip(names, own, strict=True) if mine],
            textposition=[place for place, mine in zip(places, own, strict=True) if mine],
            textfont={"size": 11},
            cliponaxis=False,
            hovertemplate="%{text}<br>%{x:+.2f} " + text(unit) + "<br>%{y:+.2f} %<extra></extra>",
            name={"found": "found", "greedy": "greedy", "paper": "the paper's"}[role],
        )
    plot.add_hline(y=0, line={"color": OUTLINE, "width": 1, "dash": "dot"})
    plot.add_vline(x=0, line={"color": OUTLINE, "width": 1, "dash": "dot"})
    axis = f"{text(objective.name)} against {text(baseline)} ({text(unit)}), {objective.better}"
    plot.update_xaxes(title=axis)
    plot.update_yaxes(title="difference (points)")
    plot.update_layout(legend={"orientation": "h", "y": -0.2, "yanchor": "top"}, showlegend=True)
    return plot

"""Spearman's rho of all surrogates and all metrics."""

from __future__ import annotations

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.style import figure
from tracking.labels import in_order, metric_label, signed, surrogate_name


def heat_map(correlations: pd.DataFrame, title: str) -> go.Figure | None:
    """Surrogates as rows, metrics as columns; blue falls, orange rises.

    Args:
        correlations: rows of `correlate` for one class, detector and setting.

    Returns:
        None if there is no coefficient at all.
    """
    known = correlations[correlations["spearman"].notna()]
    if known.empty:
        return None
    cells = known.assign(
        column=[metric_label(*pair) for pair in zip(known["metric"], known["iou"], strict=True)]
    )
    rho, p = (
        cells.pivot(index="surrogate", columns="column", values=value).reindex(
            index=in_order(cells["surrogate"]), columns=list(dict.fromkeys(cells["column"]))
        )
        for value in ("spearman", "spearman_p")
    )
    plot = figure(title, height=132 + 30 * len(rho), margin={"l": 120, "r": 8, "t": 48, "b": 84})
    plot.add_heatmap(
        z=rho.to_numpy(),
        x=list(rho.columns),
        y=[surrogate_name(name) for name in rho.index],
        zmin=-1,
        zmax=1,
        # Two of Okabe and Ito's colours about a light middle, which keeps the numbers readable.
        colorscale=[[0, "#56B4E9"], [0.5, "#f7f7f7"], [1, "#E69F00"]],
        text=np.where(rho.isna(), "", rho.map(signed)),
        texttemplate="%{text}",
        textfont={"color": "#1d2126"},
        customdata=p.to_numpy(),
        hovertemplate="%{y}, %{x}<br>ρ = %{z:+.3f}, p = %{customdata:.2g}<extra></extra>",
        showscale=False,
        xgap=2,
        ygap=2,
    )
    plot.update_yaxes(autorange="reversed", showgrid=False, ticks="")
    plot.update_xaxes(showgrid=False, ticks="", tickangle=-45)
    return plot

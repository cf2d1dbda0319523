"""Spearman's rho between surrogates, over placements."""

from __future__ import annotations

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import figure
from tracking.labels import in_order, surrogate_name
from tracking.numbers import signed


def surrogate_agreement(surrogates: pd.DataFrame, title: str) -> go.Figure | None:
    """Do the surrogates rank the placements alike? Surrogates as rows and columns.

    Args:
        surrogates: placements as rows, surrogates as columns (`surrogates_of`).
        title: plotly text.

    Returns:
        None for fewer than 3 placements, or fewer than 2 surrogates that vary over them.
    """
    own = surrogates[in_order(surrogates.columns)].dropna(axis="columns", how="all")
    own = own.loc[:, own.nunique() > 1]
    if len(own) < 3 or own.shape[1] < 2:
        return None
    rho = own.corr("spearman")
    names = [surrogate_name(str(name)) for name in rho.columns]
    plot = figure(title, height=132 + 30 * len(rho), margin={"l": 120, "r": 8, "t": 48, "b": 84})
    plot.add_heatmap(
        z=rho.to_numpy(),
        x=names,
        y=names,
        zmin=-1,
        zmax=1,
        colorscale=[[0, "#56B4E9"], [0.5, "#f7f7f7"], [1, "#E69F00"]],
        text=np.where(rho.isna(), "", rho.map(signed)),
        texttemplate="%{text}",
        textfont={"color": "#1d2126"},
        hovertemplate="%{y}, %{x}<br>ρ = %{z:+.3f}<extra></extra>",
        showscale=False,
        xgap=2,
        ygap=2,
    )
    plot.update_yaxes(autorange="reversed", showgrid=False, ticks="")
    plot.update_xaxes(showgrid=False, ticks="", tickangle=-45)
    return plot

"""Spearman's rho between surrogates, over placements."""

from __future__ import annotations

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import figure
from tracking.figures.of_sweeps.heat_map import add_coefficients
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
    add_coefficients(plot, rho, names, names, rho.map(signed))
    return plot

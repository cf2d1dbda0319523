"""Differences between two placements, with intervals."""

from __future__ import annotations

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import OUTLINE
from tracking.figures.of_sweeps.side_by_side import side_by_side


def differences_figure(differences: pd.DataFrame, title: str, axis: str) -> go.Figure:
    """A row a pair, a colour a detector, bars for intervals; the dotted line is no difference.

    Args:
        differences: pair, detector, difference, low, high (NaN for no interval).
        title: plotly text.
        axis: title of the axis, with the unit.
    """
    columns = {
        str(detector): own.set_index("pair").rename(columns={"difference": "mean"})
        for detector, own in differences.groupby("detector", sort=False)
    }
    plot = side_by_side(columns, list(dict.fromkeys(differences["pair"])), title, axis)
    plot.add_vline(x=0, line={"color": OUTLINE, "dash": "dot", "width": 1.5})
    return plot

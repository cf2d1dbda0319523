"""A metric of rigs by what objects are told apart by, as a table of colours."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.colors import get_colorscale, hex_to_rgb

from tracking.figures.kit.style import SEQUENTIAL, figure, text
from tracking.figures.of_sweeps.by_bin import Bins
from tracking.numbers import digits

_ROW = 24  # pixels
_PALE = [
    [at, "rgb({:.0f}, {:.0f}, {:.0f})".format(*(0.35 * np.array(hex_to_rgb(own)) + 0.65 * 255))]
    for at, own in get_colorscale(SEQUENTIAL)
]


def bin_table(
    values: pd.DataFrame,
    objects: pd.Series,
    bins: Bins,
    title: str,
    limits: tuple[float, float],
    enough: Collection[str],
) -> go.Figure:
    """Cells with their numbers, dark where little is found, pale where there are few objects.

    Args:
        values: placements as rows from top to bottom, bins as columns, in percent; NaN for none.
        objects: how many of them there are, by bin.
        bins: those that are drawn, in order.
        title: plotly text.
        limits: of the darkest and the brightest colour, percent.
        enough: bins with so many objects that they can be judged.
    """
    cells = values.reindex(columns=bins.names)
    margin = {"l": 8, "r": 8, "t": 48, "b": 44}
    plot = figure(title, height=92 + _ROW * len(cells), margin=margin)
    judged = cells.columns.isin(list(enough))
    for own, scale, form in ((judged, SEQUENTIAL, "{}"), (~judged, _PALE, "({})")):
        shown = cells.loc[:, own].reindex(columns=bins.names).to_numpy(np.float64)
        plot.add_heatmap(
            z=shown,
            x=list(range(len(bins.names))),
            y=[text(name) for name in cells.index],
            zmin=limits[0],
            zmax=limits[1],
            colorscale=scale,
            showscale=False,
            text=[
                [
                    form.format(digits(v, ".0f")) if here else ""
                    for v, here in zip(row, own, strict=True)
                ]
                for row in shown
            ],
            texttemplate="%{text}",
            customdata=np.tile(np.asarray(bins.names, object), (len(cells), 1)),
            hovertemplate=f"%{{y}}, %{{customdata}}{bins.unit}: %{{z:.1f}} %<extra></extra>",
            hoverongaps=False,
            xgap=2,
            ygap=2,
        )
    plot.update_xaxes(
        tickvals=list(range(len(bins.names))),
        ticktext=[f"{name.replace(' ', '<br>')}<br>n {objects[name]:,}" for name in bins.names],
        tickfont={"size": 11},
        tickangle=0,
        showgrid=False,
        ticks="",
    )
    plot.update_yaxes(autorange="reversed", showgrid=False, ticks="")
    return plot

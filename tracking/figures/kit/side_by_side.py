"""Rows under several columns: placements by metric, cases by rig."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit import style


def side_by_side(
    columns: Mapping[str, pd.DataFrame],
    rows: Sequence[str],
    title: str,
    axis: str,
    odds: Sequence[str] = (),
    hover: str = "%{x:.1f}",
) -> go.Figure:
    """Draw points in `rows`, a colour a column, with bars from low to high (NaN for none).

    `odds`, how likely each row is to be the best, are on the right; `hover` is plotly's text of
    a point that is pointed at."""
    plot = style.figure(title, height=150 + (24 + 8 * len(columns)) * len(rows))
    for i, (name, values) in enumerate(columns.items()):
        values = values.reindex(list(rows))
        mean = values["mean"]
        up, down = (values["high"] - mean).fillna(0), (mean - values["low"]).fillna(0)
        # One below the other within a row, as bars of equal values would hide each other.
        place = np.arange(len(rows)) + 0.5 * ((i + 0.5) / len(columns) - 0.5)
        plot.add_scatter(
            x=mean.to_numpy(),
            y=place,
            error_x=style.error_bars(up, down, thickness=1.5),
            mode="markers",
            marker={"size": 9, "color": style.colour(i), "symbol": style.symbol(i)},
            name=style.text(name),
            customdata=[style.text(row) for row in rows],
            hovertemplate=f"%{{customdata}}: {hover}<extra>%{{fullData.name}}</extra>",
            showlegend=True,
        )
    plot.update_xaxes(title=axis)
    style.name_rows(plot, rows)
    if odds:
        right = {"x": 1.01, "xref": "paper", "xanchor": "left", "align": "left", "showarrow": False}
        for row, note in [*enumerate(map(style.text, odds)), (-0.9, "likely to<br>be the best")]:
            plot.add_annotation(y=row, text=note, font={"size": 11}, **right)
        plot.update_yaxes(range=[len(odds) - 0.5, -1.4])
        plot.update_layout(margin={"r": 84})
    return style.legend_below(plot)

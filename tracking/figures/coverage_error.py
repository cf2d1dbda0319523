"""Error of the coverage methods against the seconds that they take."""

from __future__ import annotations

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.style import colour, figure

_COLOURS = {"cone": colour(2), "dda": colour(0), "bresenham": colour(5)}


def coverage_error(accuracy: pd.DataFrame) -> go.Figure:
    """Medians over placements and classes, bars from the smallest to the largest error.

    Args:
        accuracy: `coverage_accuracy.parquet`: method, azimuth_steps, seconds, relative_error.
    """
    table = accuracy.assign(error=accuracy["relative_error"].abs())
    sampled = table[table["method"] != "cone"]
    positive = sampled.loc[sampled["error"] > 0, "error"]
    # An error of 0 has no place on a logarithmic axis: it is drawn hollow, below all others.
    floor = 10 ** np.floor(np.log10(positive.min()) - 0.5) if len(positive) else 1e-16
    plot = figure("Relative error of S-MIG against run time", height=430)
    for method, group in sampled.groupby("method", sort=False):
        points = group.groupby("azimuth_steps").agg(
            seconds=("seconds", "median"),
            error=("error", "median"),
            low=("error", "min"),
            high=("error", "max"),
        )
        shown = points["error"].clip(lower=floor)
        plot.add_scatter(
            x=points["seconds"].to_numpy(),
            y=shown.to_numpy(),
            error_y={
                "type": "data",
                "array": (points["high"].clip(lower=floor) - shown).to_numpy(),
                "arrayminus": (shown - points["low"].clip(lower=floor)).to_numpy(),
                "symmetric": False,
                "thickness": 1,
            },
            mode="lines+markers+text",
            line={"color": _COLOURS.get(str(method), colour(6))},
            marker={
                "size": 9,
                "symbol": np.where(points["error"] > 0, "circle", "circle-open").tolist(),
            },
            text=[f"{steps:,}" for steps in points.index],
            textposition="bottom center" if method == "dda" else "top center",
            cliponaxis=False,
            customdata=points["error"].to_numpy(),
            hovertemplate="%{text} azimuth steps<br>%{x:.3g} s, error %{customdata:.2e}",
            name=str(method),
        )
    exact = table.loc[table["method"] == "cone", "seconds"]
    if len(exact):
        seconds = float(exact.median())
        plot.add_vline(x=seconds, line={"color": _COLOURS["cone"], "width": 2, "dash": "dash"})
        # On a logarithmic axis an annotation counts in powers of ten, a line in seconds.
        plot.add_annotation(
            x=np.log10(seconds),
            y=1,
            yref="paper",
            text=f"cone, the exact reference: {_duration(seconds)}",
            textangle=-90,
            xanchor="right",
            yanchor="top",
            xshift=-3,
            showarrow=False,
            font={"color": _COLOURS["cone"]},
        )
    plot.update_xaxes(type="log", title="time of one placement and class (s)", dtick=1)
    plot.update_yaxes(type="log", title="relative error", exponentformat="power", dtick=1)
    plot.update_layout(legend={"orientation": "h", "y": 1.0, "yanchor": "bottom"})
    return plot


def _duration(seconds: float) -> str:
    return f"{1000 * seconds:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"

"""Lines of placements over what objects are told apart by: distance, direction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import colour, error_bars, figure, symbol, text

_SPREAD = 0.35  # of a bin's width, over which the markers of placements are set apart


@dataclass(frozen=True)
class Bins:
    """What objects are told apart by.

    Attributes:
        of: what it is, with its unit.
        names: of the bins, in order.
        unit: what stands behind a name.
    """

    of: str
    names: tuple[str, ...]
    unit: str = ""


def by_bin(
    table: pd.DataFrame,
    bins: Bins,
    title: str,
    axis: str,
    placements: Sequence[str],
    log: bool = False,
) -> go.Figure:
    """A line a placement, its colour that of the whole page; bars are intervals.

    Args:
        table: placement, bin, value, number of `objects`, and `low` and `high`, missing where there
            is no interval.
        title: plotly text.
        axis: what `value` is, with its unit.
        placements: all of the sweep, in order, so that a placement keeps its colour.
        log: a logarithmic axis; zeros are not drawn.
    """
    plot = figure(title, height=400)
    number = {name: i for i, name in enumerate(bins.names)}
    shown = [name for name in placements if name in set(table["placement"])]
    for place, name in enumerate(shown):
        own = table[table["placement"] == name].sort_values("bin", key=lambda of: of.map(number))
        offset = _SPREAD * ((place + 0.5) / len(shown) - 0.5)
        rank = placements.index(name)
        value = own["value"].to_numpy(np.float64)
        plot.add_scatter(
            x=own["bin"].map(number) + offset,
            y=value,
            error_y=error_bars(own["high"] - value, value - own["low"], thickness=1, width=2)
            if own["low"].notna().any()
            else None,
            mode="lines+markers",
            line={"color": colour(rank), "width": 1.5},
            marker={"size": 6, "symbol": symbol(rank)},
            name=text(name),
            customdata=own["bin"] + bins.unit,
            text=[f"{count:,}" for count in own["objects"]],
            hovertemplate=f"{text(name)}<br>%{{customdata}}, %{{text}} objects<br>"
            "%{y:.4g}<extra></extra>",
        )
    plot.update_xaxes(
        title=bins.of,
        tickvals=list(range(len(bins.names))),
        ticktext=bins.names,
        range=[-0.5, len(bins.names) - 0.5],
    )
    plot.update_yaxes(title=axis)
    if log:
        # Whole numbers: plotly's own are single digits between powers of ten.
        ticks = [digit * 10.0**power for power in range(-2, 7) for digit in (1, 2, 5)]
        plot.update_yaxes(type="log", tickvals=ticks, ticktext=[f"{tick:,g}" for tick in ticks])
    plot.update_layout(legend={"orientation": "h", "y": -0.2})
    return plot

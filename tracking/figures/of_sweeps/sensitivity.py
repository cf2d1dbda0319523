"""The spread of AP and recall over placements, by detector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import colour, figure, legend_below, symbol, text
from tracking.labels import metric_label, setting_label


def sensitivity_figure(spreads: pd.DataFrame, axes: Sequence[str], title: str) -> go.Figure | None:
    """A row a detector and setting, a point a metric; a tick where seeds alone would reach.

    Args:
        spreads: rows of `tracking.findings.sensitivity.sensitivity` for one class.
        axes: further axes of the grid.
        title: a name, not yet plotly's text.

    Returns:
        None if there is nothing to draw.
    """
    if spreads.empty:
        return None
    rows = [
        "<br>".join(text(part) for part in (row["detector"], _setting(row, axes)) if part)
        for row in spreads.to_dict("records")
    ]
    table = spreads.assign(row=rows)
    order = list(dict.fromkeys(rows))
    metrics = list(dict.fromkeys(zip(table["metric"], table["iou"], strict=True)))
    plot = figure(f"Spread over placements · {text(title)}", height=150 + 34 * len(order))
    for i, (metric, iou) in enumerate(metrics):
        own = table[(table["metric"] == metric) & (table["iou"] == iou)]
        label = metric_label(metric, iou)
        plot.add_scatter(
            x=own["spread"].to_numpy(),
            y=own["row"].tolist(),
            mode="markers",
            marker={"size": 10, "color": colour(i), "symbol": symbol(i)},
            name=label,
            customdata=np.stack([own["best"], own["worst"]], axis=-1),
            hovertemplate="%{y}: %{x:.1f} points, from %{customdata[1]} to %{customdata[0]}"
            f"<extra>{label}</extra>",
        )
        chance = own[own["by_chance"].notna()]
        plot.add_scatter(
            x=chance["by_chance"].to_numpy(),
            y=chance["row"].tolist(),
            mode="markers",
            marker={
                "size": 14,
                "symbol": "line-ns-open",
                "line": {"width": 2, "color": colour(i)},
                "color": colour(i),
            },
            name="by seeds alone",
            legendgroup="chance",
            showlegend=i == 0 and len(chance) > 0,
            hovertemplate=f"%{{y}}: seeds alone make up to %{{x:.1f}} points<extra>{label}</extra>",
        )
    plot.update_xaxes(title="best less worst placement (points)", rangemode="tozero")
    plot.update_yaxes(categoryorder="array", categoryarray=order[::-1])
    legend_below(plot)
    return plot


def _setting(row: dict[Any, Any], axes: Sequence[str]) -> str:
    return setting_label(axes, [row[axis] for axis in axes])

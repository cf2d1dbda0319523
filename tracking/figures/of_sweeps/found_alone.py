"""How many objects each of two rigs finds alone, by what objects are told apart by."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import OUTLINE, colour, figure, legend_below, text


def found_alone(
    counts: pd.DataFrame,
    rigs: tuple[str, str],
    title: str,
    bins: list[str],
    classes: Sequence[str],
) -> go.Figure:
    """Bars to the right for the first rig, to the left for the second one, a colour a class.

    Args:
        counts: class, bin, objects, first, second: single classes of one dimension.
        title: plotly text.
        bins: rows from top to bottom.
        classes: of the sweep, in order, so that a class keeps its colour.
    """
    total = counts.groupby("bin")["objects"].sum()
    plot = figure(title, height=130 + 34 * len(bins), barmode="relative", bargap=0.3)
    for name in classes:
        own = counts[counts["class"] == name].set_index("bin")[["first", "second", "objects"]]
        own = own.reindex(bins, fill_value=0)
        for rig, key, sign in zip(rigs, ("first", "second"), (1, -1), strict=True):
            plot.add_bar(
                x=sign * own[key].to_numpy(),
                y=list(range(len(bins))),
                orientation="h",
                marker={"color": colour(classes.index(name))},
                name=text(name),
                legendgroup=name,
                showlegend=sign > 0,
                customdata=own[[key, "objects"]].to_numpy(),
                hovertemplate=f"{text(rig)} alone: %{{customdata[0]:.1f}} of "
                f"%{{customdata[1]:,}}<extra>{text(name)}</extra>",
            )
    most = 1.08 * max(counts.groupby("bin")[["first", "second"]].sum().max().max(), 1.0)
    plot.add_vline(x=0, line={"color": OUTLINE, "width": 1})
    plot.update_xaxes(
        title=f"objects: ← {text(rigs[1])} alone<br>{text(rigs[0])} alone →",
        range=[-most, most],
        tickformat=",.0f",
    )
    plot.update_yaxes(
        tickvals=list(range(len(bins))),
        ticktext=[f"{text(name)}, n {total[name]:,}" for name in bins],
        range=[len(bins) - 0.5, -0.5],
    )
    legend_below(plot)
    return plot

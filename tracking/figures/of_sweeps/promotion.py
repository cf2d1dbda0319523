"""Ranks of the placements through the rungs of a promotion, and error against run time."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import OUTLINE, colour, figure, text

_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


def ranks_by_stage(ranks: pd.DataFrame, kept: Sequence[int], title: str) -> go.Figure:
    """Rank of every placement at every stage, pruned ones grey; a dash marks how far a rung kept.

    Args:
        ranks: `tracking.findings.promotion.stage_ranks`, the last column is the full training.
        kept: placements that each rung kept.
        title: plotly text.
    """
    stages = [*(f"rung {i}" for i in range(1, len(kept) + 1)), "full training"]
    last = ranks.columns[-1]
    finalists = ranks[ranks[last].notna()].sort_values(last)
    pruned = ranks.drop(index=finalists.index)
    plot = figure(title, height=400)
    # Lines that end early, in one trace: a gap between two placements.
    lines = np.full((len(pruned), len(stages) + 1), np.nan)
    lines[:, :-1] = pruned
    plot.add_scatter(
        x=np.tile([*stages, stages[-1]], len(pruned)),
        y=lines.ravel(),
        mode="lines+markers",
        line={"color": OUTLINE, "width": 1},
        marker={"size": 4},
        opacity=0.45,
        text=np.repeat([text(name) for name in pruned.index], len(stages) + 1),
        hovertemplate="%{text}, %{x}: rank %{y}<extra></extra>",
        showlegend=False,
    )
    for i, name in enumerate(finalists.index):
        plot.add_scatter(
            x=stages,
            y=finalists.loc[name].to_numpy(),
            mode="lines+markers",
            line={"color": colour(i), "width": 2},
            marker={"size": 8},
            name=text(name),
            hovertemplate=f"{text(name)}, %{{x}}: rank %{{y}}<extra></extra>",
        )
    plot.add_scatter(
        x=stages[:-1],
        y=[count + 0.5 for count in kept],
        mode="markers",
        marker={"symbol": "line-ew-open", "size": 22, "line": {"width": 2}, "color": OUTLINE},
        name="kept up to here",
        hoverinfo="skip",
    )
    worst = float(np.nanmax(ranks.to_numpy()))
    plot.update_yaxes(
        title="rank",
        type="log",
        range=[np.log10(1.25 * worst), np.log10(0.8)],
        tickvals=[rank for rank in _TICKS if rank <= worst],
    )
    plot.update_xaxes(categoryorder="array", categoryarray=stages, range=[-0.3, len(stages) - 0.7])
    plot.update_layout(legend={"orientation": "h", "y": -0.14, "yanchor": "top"})
    return plot


def error_over_seconds(to_full: pd.DataFrame, seconds_full: float, title: str) -> list[go.Figure]:
    """Errors of every rung over its seconds for a placement; a star is the full training.

    The share of pairs of placements that the rung orders unlike the full training, (1 − τ) / 2,
    unless no rung has a τ; and how much less AP the placement that it ranks highest has than the
    best.

    Args:
        to_full: rows of `tracking.findings.promotion_agreement.agreement` with the full training,
            some.
        seconds_full: of the full training of a placement, all seeds.
        title: plotly text that ends both titles.
    """
    figures = []
    if to_full["kendall"].notna().any():
        share = _errors(to_full, 50 * (1 - to_full["kendall"]), seconds_full)
        share.update_layout(title={"text": f"Pairs ordered unlike full training{title}"})
        share.update_yaxes(title="share of pairs (%)")
        figures.append(share)
    lost = _errors(to_full, to_full["regret"], seconds_full)
    lost.update_layout(title={"text": f"AP lost by taking the first of a rung{title}"})
    lost.update_yaxes(title="points of AP")
    return [*figures, lost]


def _errors(to_full: pd.DataFrame, error: pd.Series, seconds_full: float) -> go.Figure:
    names = [*to_full["earlier"], "full training"]
    seconds = [*to_full["seconds"], seconds_full]
    plot = figure("", height=400)
    plot.add_scatter(
        x=seconds,
        y=[*error, 0.0],
        mode="markers+text",
        marker={
            "size": [*([10] * len(to_full)), 14],
            "symbol": [*(["circle"] * len(to_full)), "star"],
            "color": [*([colour(0)] * len(to_full)), colour(5)],
        },
        text=[*(f"rung {i}" for i in to_full["rung"]), "full"],
        textposition="top center",
        cliponaxis=False,
        customdata=[text(name) for name in names],
        hovertemplate="%{customdata}<br>%{x:.3g} s: %{y:.3g}<extra></extra>",
        showlegend=False,
    )
    known = [value for value in seconds if value > 0]
    plot.update_xaxes(
        type="log",
        range=np.log10([min(known) / 3, max(known) * 3]),
        dtick=1,
        title="seconds a placement",
    )
    top = float(np.nanmax([*error, 0.0])) or 1.0
    plot.update_yaxes(range=[-0.08 * top, 1.2 * top])
    return plot

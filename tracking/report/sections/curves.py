"""The section of learning curves."""

from collections.abc import Sequence

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import colour, figure, symbol, text
from tracking.findings.groups import has_detectors
from tracking.pages.section import Section
from tracking.report.analysis import Analysis


def curves_section(found: Analysis) -> Section | None:
    """A figure a group and metric of training; None for a sweep without detectors."""
    run = found.run
    if not has_detectors(run):
        return None
    section = Section("Learning curves")
    if run.curves is None or run.curves.empty:
        section.notes.append("The run folder has no curves.parquet.")
        return section
    section.notes.append("One line a trial; lines of one colour differ by seed.")
    for group in found.groups:
        for metric in dict.fromkeys(run.curves["metric"]):
            plot = learning_curves(
                run.curves, group.of(run.trials), metric, text(group.title), list(run.placements)
            )
            section.figures.append(plot)
    section.columns = min(2, len(section.figures))
    return section


def learning_curves(
    curves: pd.DataFrame, trials: pd.DataFrame, metric: str, title: str, placements: Sequence[str]
) -> go.Figure:
    """One line a trial, a colour a placement: lines of one colour differ by seed.

    Args:
        curves: trial, epoch, metric, value.
        trials: the trials to show: trial, placement, seed.
        placements: all of the sweep, in order, so that a placement keeps its colour.
    """
    plot = figure(title, height=400)
    shown: set[str] = set()
    points = curves[curves["metric"] == metric].sort_values("epoch")
    for trial in trials.to_dict("records"):
        line = points[points["trial"] == trial["trial"]]
        if line.empty:
            continue
        name = str(trial["placement"])
        rank = placements.index(name)
        plot.add_scatter(
            x=line["epoch"].to_numpy(),
            y=line["value"].to_numpy(),
            mode="lines+markers",
            line={"color": colour(rank), "width": 1.5},
            marker={"size": 5, "symbol": symbol(rank)},
            name=text(name),
            legendgroup=str(rank),
            showlegend=name not in shown,
            hovertemplate=f"{text(name)}, seed {trial['seed']}<br>"
            "epoch %{x}: %{y:.4g}<extra></extra>",
        )
        shown.add(name)
    plot.update_xaxes(title="epoch", tick0=0, dtick=max(1, round(points["epoch"].max() / 10)))
    plot.update_yaxes(title=text(metric))
    plot.update_layout(legend={"orientation": "h", "y": -0.2})
    return plot

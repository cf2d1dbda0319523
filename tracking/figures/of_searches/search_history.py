"""The best value of a search against evaluations, and its upper bound against seconds."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import OUTLINE, colour, figure, text
from tracking.run_folders.search_json import Objective

_BOUND, _GREEDY, _PAPER = colour(5), colour(2), colour(1)


def search_history(
    trials: pd.DataFrame,
    objective: Objective,
    bound: float | None,
    greedy: float | None,
    paper: Mapping[str, float],
) -> go.Figure:
    """A mark a trial, the best feasible value so far as a line, peers as level lines.

    All values are as the search computes them.

    Args:
        trials: those that were evaluated, sorted by number.
        objective: whose values are drawn.
        bound, greedy: None if there is none.
        paper: values of the paper's eight, the best first.
    """
    plot = figure(text(objective.name), height=440)
    value = trials[f"value.{objective.name}"].to_numpy(np.float64)
    kept = trials["feasible"].to_numpy(bool)
    count = np.arange(1, len(value) + 1)
    for own, name, shade, shape in (
        (kept, "trial", OUTLINE, "circle"),
        (~kept, "trial that breaks a constraint", colour(3), "x-thin-open"),
    ):
        if own.any():
            plot.add_scattergl(
                x=count[own].astype(np.float32),
                y=value[own].astype(np.float32),
                mode="markers",
                marker={"size": 5, "color": shade, "symbol": shape, "opacity": 0.6},
                customdata=trials["number"].to_numpy(np.int32)[own],
                hovertemplate="trial %{customdata}: %{y:,.6g}<extra></extra>",
                name=name,
            )
    if kept.any():
        best = objective.sign * np.fmax.accumulate(np.where(kept, objective.sign * value, np.nan))
        plot.add_scatter(
            x=count.astype(np.float32),
            y=best.astype(np.float32),
            mode="lines",
            line={"color": colour(0), "width": 2.5, "shape": "hv"},
            name="best so far",
            hovertemplate="best after %{x}: %{y:,.6g}<extra></extra>",
        )
    ends = (0, max(len(value), 1))
    if bound is not None:
        _level(plot, ends, bound, "upper bound", _BOUND, "dash")
    if greedy is not None:
        _level(plot, ends, greedy, "greedy", _GREEDY, "dashdot")
    for i, (name, level) in enumerate(paper.items()):
        if i == 0:
            _level(plot, ends, level, f"{name}, best of the paper", _PAPER, "dot")
        else:
            _level(plot, ends, level, "others of the paper", OUTLINE, "dot", name, i == 1)
    plot.update_xaxes(title="evaluations", rangemode="tozero")
    plot.update_yaxes(title=text(objective.label))
    plot.update_layout(legend={"orientation": "h", "y": -0.16, "yanchor": "top"})
    return plot


def bound_over_seconds(bound: pd.DataFrame, objective: Objective, best: float | None) -> go.Figure:
    """How the upper bound fell while it was computed.

    Args:
        bound: seconds, bound, kind.
        objective: the first one.
        best: value of the best rig, as the search computes it.
    """
    plot = figure(f"Upper bound of {text(objective.name)}", height=440)
    for i, (kind, part) in enumerate(bound.groupby("kind", sort=False)):
        part = part.sort_values("seconds")
        plot.add_scatter(
            x=part["seconds"].to_numpy(),
            y=part["bound"].to_numpy(),
            mode="lines+markers",
            line={"color": (_BOUND, colour(4), colour(3))[i % 3], "width": 2, "shape": "hv"},
            name=f"bound: {text(kind)}",
            hovertemplate="%{x:.3g} s: %{y:,.6g}<extra></extra>",
        )
    if best is not None:
        ends = (0.0, float(bound["seconds"].max()))
        _level(plot, ends, best, "best rig", colour(0), "dot")
    plot.update_xaxes(title="seconds", rangemode="tozero")
    plot.update_yaxes(title=text(objective.label))
    plot.update_layout(legend={"orientation": "h", "y": -0.16, "yanchor": "top"})
    return plot


def _level(
    plot: go.Figure,
    ends: tuple[float, float],
    value: float,
    name: str,
    shade: str,
    dash: str,
    hover: str | None = None,
    listed: bool = True,
) -> None:
    """A level line; `listed` in the legend as `name`, told as `hover` or `name`."""
    plot.add_scatter(
        x=ends,
        y=[value, value],
        mode="lines",
        line={"color": shade, "width": 1.5 if hover is None else 1, "dash": dash},
        name=text(name),
        legendgroup=name,
        showlegend=listed,
        hovertemplate=f"{text(hover or name)}: %{{y:,.6g}}<extra></extra>",
    )

"""Pairs of objectives: the Pareto front among all trials and the rigs that are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.style import OUTLINE, colour, figure, text
from tracking.search_result import Objective, Rig

_ROLES = {
    "paper": ("the paper's eight", "diamond", colour(1)),
    "greedy": ("greedy", "star", colour(2)),
    "found": ("found, not on the front", "circle", colour(4)),
}


def pareto_fronts(
    trials: pd.DataFrame,
    objectives: Sequence[Objective],
    rigs: Mapping[str, Rig],
    front: Sequence[str],
) -> list[go.Figure]:
    """A figure for every pair of objectives.

    Args:
        trials: those that were evaluated.
        objectives: two or more.
        rigs: by name; front: names of those on the Pareto front.
    """
    feasible = trials[trials["feasible"].astype(bool)]
    return [_front(feasible, a, b, rigs, front) for a, b in combinations(objectives, 2)]


def _front(
    trials: pd.DataFrame, a: Objective, b: Objective, rigs: Mapping[str, Rig], front: Sequence[str]
) -> go.Figure:
    plot = figure(f"{text(a.name)} and {text(b.name)}", height=420)
    plot.add_scattergl(
        x=trials[f"value.{a.name}"].to_numpy(np.float32),
        y=trials[f"value.{b.name}"].to_numpy(np.float32),
        mode="markers",
        marker={"size": 4, "color": OUTLINE, "opacity": 0.5},
        customdata=trials["number"].to_numpy(np.int32),
        hovertemplate="trial %{customdata}: %{x:,.5g}, %{y:,.5g}<extra></extra>",
        name="feasible trial",
    )
    for role, (label, shape, shade) in _ROLES.items():
        names = [n for n, rig in rigs.items() if rig.role == role and n not in front]
        _add_rigs(plot, names, rigs, (a, b), label, {"size": 10, "symbol": shape, "color": shade})
    # Along the first objective, so that the line is the front where there are two.
    ordered = sorted(front, key=lambda name: rigs[name].value(a))
    marker = {"size": 9, "color": colour(0), "line": {"color": "#ffffff", "width": 1}}
    _add_rigs(plot, ordered, rigs, (a, b), "Pareto front", marker)
    plot.update_xaxes(title=f"{text(a.label)}, {_better(a)}")
    plot.update_yaxes(title=f"{text(b.label)}, {_better(b)}")
    plot.update_layout(legend={"orientation": "h", "y": -0.18, "yanchor": "top"})
    return plot


def _better(objective: Objective) -> str:
    return "more is better" if objective.sign > 0 else "less is better"


def _add_rigs(
    plot: go.Figure,
    names: Sequence[str],
    rigs: Mapping[str, Rig],
    pair: tuple[Objective, Objective],
    label: str,
    marker: dict[str, object],
) -> None:
    if not names:
        return
    plot.add_scatter(
        x=[rigs[name].value(pair[0]) for name in names],
        y=[rigs[name].value(pair[1]) for name in names],
        mode="markers",
        marker=marker,
        text=[text(name) for name in names],
        hovertemplate="%{text}<br>%{x:,.5g}, %{y:,.5g}<extra></extra>",
        name=label,
    )

"""Pairs of objectives: the Pareto front among all trials and the rigs that are known."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import OUTLINE, colour, figure, text
from tracking.run_folders.search_json import Objective, Rig

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
    """A figure for every pair of objectives, of values as the search computes them.

    Args:
        trials: those that were evaluated.
        objectives: two or more.
        rigs: by name, those without a value of the pair are left out; front: names of those on the
            Pareto front.
    """
    feasible = trials[trials["feasible"].astype(bool)]
    return [_front(feasible, a, b, rigs, front) for a, b in combinations(objectives, 2)]


def _front(
    trials: pd.DataFrame, a: Objective, b: Objective, rigs: Mapping[str, Rig], front: Sequence[str]
) -> go.Figure:
    plot = figure(f"{text(a.name)} and {text(b.name)}", height=420)
    points = {name: (rig.searched_value(a), rig.searched_value(b)) for name, rig in rigs.items()}
    known = {name: point for name, point in points.items() if np.isfinite(point).all()}
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
        own = {n: p for n, p in known.items() if rigs[n].role == role and n not in front}
        _add_rigs(plot, own, label, {"size": 10, "symbol": shape, "color": shade})
    # Along the first objective, so that the line is the front where there are two.
    ordered = sorted((name for name in front if name in known), key=known.__getitem__)
    marker = {"size": 9, "color": colour(0), "line": {"color": "#ffffff", "width": 1}}
    _add_rigs(plot, {name: known[name] for name in ordered}, "Pareto front", marker)
    plot.update_xaxes(title=f"{text(a.label)}, {a.better}")
    plot.update_yaxes(title=f"{text(b.label)}, {b.better}")
    plot.update_layout(legend={"orientation": "h", "y": -0.18, "yanchor": "top"})
    return plot


def _add_rigs(
    plot: go.Figure,
    points: Mapping[str, tuple[float, float]],
    label: str,
    marker: dict[str, object],
) -> None:
    if not points:
        return
    plot.add_scatter(
        x=[x for x, _ in points.values()],
        y=[y for _, y in points.values()],
        mode="markers",
        marker=marker,
        text=[text(name) for name in points],
        hovertemplate="%{text}<br>%{x:,.5g}, %{y:,.5g}<extra></extra>",
        name=label,
    )

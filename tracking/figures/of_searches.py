"""Figures of a search: its history, its fronts, and its rigs against the baseline."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.vehicle import Vehicle
from tracking.figures.kit.side_by_side import side_by_side
from tracking.figures.kit.style import DIVERGING, OUTLINE, colour, figure, text
from tracking.figures.kit.vehicle_lines import add_vehicle, pog_from_above
from tracking.run_folders.search_json import Objective, Rig

_BOUND = {"color": colour(5), "width": 1.5, "dash": "dash"}
_GREEDY = {"color": colour(2), "width": 1.5, "dash": "dashdot"}
_PAPER = {"color": colour(1), "width": 1.5, "dash": "dot"}
_BEST = {"color": colour(0), "width": 1.5, "dash": "dot"}
_OTHERS = {"color": OUTLINE, "width": 1, "dash": "dot"}


def search_history(
    trials: pd.DataFrame,
    objective: Objective,
    bound: float | None,
    greedy: float | None,
    peers: Mapping[str, float],
    kind: str = "paper",
) -> go.Figure:
    """Draw a mark a trial, the best feasible value so far as a line, peers as level lines.

    All values are as the search computes them; `trials` were evaluated and are sorted by number,
    `peers` has values of the rigs to compare with, the best first; `kind` names them."""
    plot = figure(text(objective.name), height=440)
    value = trials[f"value.{objective.name}"].to_numpy(np.float64)
    feasible = trials["feasible"].to_numpy(bool)
    count = np.arange(1, len(value) + 1)
    for marked, name, shade, shape in (
        (feasible, "trial", OUTLINE, "circle"),
        (~feasible, "trial that breaks a constraint", colour(3), "x-thin-open"),
    ):
        if marked.any():
            plot.add_scattergl(
                x=count[marked].astype(np.float32),
                y=value[marked].astype(np.float32),
                mode="markers",
                marker={"size": 5, "color": shade, "symbol": shape, "opacity": 0.6},
                customdata=trials["number"].to_numpy(np.int32)[marked],
                hovertemplate="trial %{customdata}: %{y:,.6g}<extra></extra>",
                name=name,
            )
    if feasible.any():
        best = objective.sign * np.fmax.accumulate(
            np.where(feasible, objective.sign * value, np.nan)
        )
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
        _level(plot, ends, bound, "upper bound", _BOUND)
    if greedy is not None:
        _level(plot, ends, greedy, "greedy", _GREEDY)
    for i, (name, level) in enumerate(peers.items()):
        if i == 0:
            _level(plot, ends, level, f"{name}, best of the {kind}", _PAPER)
        else:
            _level(plot, ends, level, f"others of the {kind}", _OTHERS, name, i == 1)
    return _finished(plot, "evaluations", objective)


def _finished(plot: go.Figure, counted: str, objective: Objective) -> go.Figure:
    plot.update_xaxes(title=counted, rangemode="tozero")
    plot.update_yaxes(title=text(objective.label))
    return plot.update_layout(legend={"orientation": "h", "y": -0.16, "yanchor": "top"})


def bound_over_seconds(bound: pd.DataFrame, objective: Objective, best: float | None) -> go.Figure:
    """Draw how the upper bound of the first objective fell while it was computed.

    `bound` has seconds, bound and kind, `best` is the value of the best rig as searched."""
    plot = figure(f"Upper bound of {text(objective.name)}", height=440)
    for i, (kind, part) in enumerate(bound.groupby("kind", sort=False)):
        part = part.sort_values("seconds")
        plot.add_scatter(
            x=part["seconds"].to_numpy(),
            y=part["bound"].to_numpy(),
            mode="lines+markers",
            line={"color": colour((5, 4, 3)[i % 3]), "width": 2, "shape": "hv"},
            name=f"bound: {text(kind)}",
            hovertemplate="%{x:.3g} s: %{y:,.6g}<extra></extra>",
        )
    if best is not None:
        ends = (0.0, float(bound["seconds"].max()))
        _level(plot, ends, best, "best rig", _BEST)
    return _finished(plot, "seconds", objective)


def _level(
    plot: go.Figure,
    ends: tuple[float, float],
    value: float,
    name: str,
    line: Mapping[str, Any],
    hover: str | None = None,
    listed: bool = True,
) -> None:
    """Draw a level line, which is `listed` in the legend as `name`, shown as `hover` or `name`."""
    plot.add_scatter(
        x=ends,
        y=[value, value],
        mode="lines",
        line=line,
        name=text(name),
        legendgroup=name,
        showlegend=listed,
        hovertemplate=f"{text(hover or name)}: %{{y:,.6g}}<extra></extra>",
    )


_ROLES = {
    "paper": ("the paper's eight", "diamond", colour(1)),
    "plain": ("plain rigs", "diamond", colour(1)),
    "greedy": ("greedy", "star", colour(2)),
    "found": ("found, not on the front", "circle", colour(4)),
}


def pareto_fronts(
    trials: pd.DataFrame,
    objectives: Sequence[Objective],
    rigs: Mapping[str, Rig],
    front: Sequence[str],
) -> list[go.Figure]:
    """Draw a figure for every pair of objectives, of values as the search computes them.

    `trials` are those that were evaluated; `rigs` without a value of the pair are left out."""
    feasible = trials[trials["feasible"].astype(bool)]
    return [_front(feasible, a, b, rigs, front) for a, b in combinations(objectives, 2)]


def _front(
    trials: pd.DataFrame, a: Objective, b: Objective, rigs: Mapping[str, Rig], front: Sequence[str]
) -> go.Figure:
    plot = figure(f"{text(a.name)} and {text(b.name)}", height=420)
    points = {name: (rig.searched_value(a), rig.searched_value(b)) for name, rig in rigs.items()}
    with_both = {name: point for name, point in points.items() if np.isfinite(point).all()}
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
        of_role = {n: p for n, p in with_both.items() if rigs[n].role == role and n not in front}
        _add_rigs(plot, of_role, label, {"size": 10, "symbol": shape, "color": shade})
    # Along the first objective, so that the line is the front where there are two.
    ordered = sorted((name for name in front if name in with_both), key=with_both.__getitem__)
    marker = {"size": 9, "color": colour(0), "line": {"color": "#ffffff", "width": 1}}
    _add_rigs(plot, {name: with_both[name] for name in ordered}, "Pareto front", marker)
    plot.update_xaxes(title=f"{text(a.label)}, {a.better}")
    plot.update_yaxes(title=f"{text(b.label)}, {b.better}")
    return plot.update_layout(legend={"orientation": "h", "y": -0.18, "yanchor": "top"})


def _add_rigs(
    plot: go.Figure, points: Mapping[str, tuple[float, float]], label: str, marker: dict[str, Any]
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


def robustness_figure(
    rows: pd.DataFrame, objective: Objective, reference: str, designed: float
) -> go.Figure:
    """Draw a row a case: the mean, in percent of one value for all rigs; the bar ends at the worst.

    100 % is `designed` of the rig `reference`; where that is not positive, values have their
    unit."""
    relative = designed > 0
    scale, unit = (100 / designed, "%") if relative else (1.0, text(objective.unit))
    both = scale * rows.set_index(["rig", "case"])[["value", "worst"]]
    bars = pd.DataFrame({"mean": both["value"], "low": both.min(axis=1), "high": both.max(axis=1)})
    columns = {str(rig): bars.loc[rig] for rig in rows["rig"].unique()}
    title = f"percent of {text(reference)} as designed" if relative else text(objective.label)
    plot = side_by_side(
        columns,
        rows["case"].drop_duplicates().tolist(),
        text(objective.name),
        f"{title},<br>{objective.better}",
        hover=f"%{{x:.5~g}} {unit}",
    )
    if relative:
        plot.add_vline(x=100, line={"color": OUTLINE, "width": 1, "dash": "dot"})
    return plot


_CELLS = 120  # cells along the longer side: a page holds three maps a class


def unseen(
    before: NDArray[np.float32],
    after: NDArray[np.float32],
    roi: Roi,
    vehicle: Vehicle,
    names: tuple[str, str, str],
) -> list[go.Figure]:
    """Draw two maps on one scale from 0, and `after - before` on a scale about 0.

    Residual entropy of each column of voxels, nats, shape (nx, ny); `names` are the class and
    the two rigs."""
    class_name, first, second = (text(name) for name in names)
    plots = [
        pog_from_above(before, roi, f"{class_name} · unseen by {first}", _CELLS),
        pog_from_above(after, roi, f"{class_name} · unseen by {second}", _CELLS),
        pog_from_above(after - before, roi, f"{class_name} · {second} less {first}", _CELLS),
    ]
    maps = [plot.data[0] for plot in plots]
    top = max(float(heat.z.max()) for heat in maps[:2]) or 1.0
    for heat in maps[:2]:
        heat.update(zmin=0.0, zmax=top)
    widest = float(np.abs(maps[2].z).max()) or 1.0
    maps[2].update(zmin=-widest, zmax=widest, colorscale=DIVERGING)
    return [add_vehicle(plot, vehicle, roi) for plot in plots]

"""Rigs of a search against the baseline: in other cases, as AP, and in what they leave unseen."""

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.mounting.vehicle import Vehicle
from tracking.figures.kit.named_points import label_places
from tracking.figures.kit.side_by_side import side_by_side
from tracking.figures.kit.style import OUTLINE, colour, error_bars, figure, text
from tracking.figures.kit.vehicle_lines import add_vehicle, pog_from_above
from tracking.run_folders.search_json import Objective


def robustness_figure(
    rows: pd.DataFrame, objective: Objective, reference: str, designed: float
) -> go.Figure:
    """A row a case: the mean, in percent of one value for all rigs; the bar ends at the worst.

    Values are in their own unit where there is no percent: `designed` is not positive.

    Args:
        rows: rig, case, value and worst of one objective.
        reference: the rig whose value as designed is 100 %; designed: that value.
    """
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
        shown=f"%{{x:.5~g}} {unit}",
    )
    if relative:
        plot.add_vline(x=100, line={"color": OUTLINE, "width": 1, "dash": "dot"})
    return plot


_ROLES = {
    "found": ("circle", colour(0)),
    "greedy": ("star", colour(2)),
    "paper": ("diamond", colour(1)),
}


def verified_figure(
    rows: pd.DataFrame, baseline: str, surrogate: float, objective: Objective, label: str
) -> go.Figure:
    """A point a rig, both axes as differences to the baseline, which is at the origin.

    Args:
        rows: of `verified.parquet` for one class, metric and IoU.
        baseline: the rig that the others are compared to.
        surrogate: the baseline's value of `objective`.
        objective: the first one, whose values the column `surrogate` holds.
        label: class and metric, plotly text.
    """
    # The baseline differs by nothing from itself, without error.
    at_origin = ["difference", "difference_low", "difference_high"]
    rows = rows.copy()
    rows.loc[rows["rig"] == baseline, at_origin] = 0.0
    gain = (rows["surrogate"] - surrogate).to_numpy(np.float64)
    unit = objective.unit
    if surrogate > 0:
        gain, unit = 100 * gain / surrogate, "%"
    difference = rows["difference"].to_numpy(np.float64)
    names = [str(name) for name in rows["rig"]]
    plot = figure(label, height=400)
    bars = (rows["difference_high"] - rows["difference_low"]).to_numpy(np.float64) / 2
    places = label_places(gain, difference, names, bars)
    for role, (shape, shade) in _ROLES.items():
        own = (rows["role"] == role).to_numpy()
        if not own.any():
            continue
        plot.add_scatter(
            x=gain[own],
            y=difference[own],
            error_y=error_bars(
                (rows["difference_high"].to_numpy(np.float64) - difference)[own],
                (difference - rows["difference_low"].to_numpy(np.float64))[own],
                thickness=1.5,
                color=OUTLINE,
            ),
            mode="markers+text",
            marker={"size": 10, "symbol": shape, "color": shade},
            text=[text(name) for name, mine in zip(names, own, strict=True) if mine],
            textposition=[place for place, mine in zip(places, own, strict=True) if mine],
            textfont={"size": 11},
            cliponaxis=False,
            hovertemplate="%{text}<br>%{x:+.2f} " + text(unit) + "<br>%{y:+.2f} %<extra></extra>",
            name={"found": "found", "greedy": "greedy", "paper": "the paper's"}[role],
        )
    plot.add_hline(y=0, line={"color": OUTLINE, "width": 1, "dash": "dot"})
    plot.add_vline(x=0, line={"color": OUTLINE, "width": 1, "dash": "dot"})
    axis = f"{text(objective.name)} against {text(baseline)} ({text(unit)}), {objective.better}"
    plot.update_xaxes(title=axis)
    plot.update_yaxes(title="difference (points)")
    plot.update_layout(legend={"orientation": "h", "y": -0.2, "yanchor": "top"}, showlegend=True)
    return plot


_CELLS = 120
"""Cells along the longer side: a page holds three maps a class."""
_DIVERGING = [[0, "#56B4E9"], [0.5, "#f7f7f7"], [1, "#E69F00"]]
"""Blue for less, orange for more."""


def unseen(
    before: NDArray[np.float32],
    after: NDArray[np.float32],
    roi: Roi,
    vehicle: Vehicle,
    names: tuple[str, str, str],
) -> list[go.Figure]:
    """Two maps on one scale from 0, and `after - before` on a scale about 0.

    Args:
        before, after: residual entropy of each column of voxels, nats, shape (nx, ny).
        names: the class, the rig of `before` and that of `after`.
    """
    shown, first, second = (text(name) for name in names)
    plots = [
        pog_from_above(before, roi, f"{shown} · unseen by {first}", _CELLS),
        pog_from_above(after, roi, f"{shown} · unseen by {second}", _CELLS),
        pog_from_above(after - before, roi, f"{shown} · {second} less {first}", _CELLS),
    ]
    maps = [plot.data[0] for plot in plots]
    top = max(float(heat.z.max()) for heat in maps[:2]) or 1.0
    for heat in maps[:2]:
        heat.update(zmin=0.0, zmax=top)
    widest = float(np.abs(maps[2].z).max()) or 1.0
    maps[2].update(zmin=-widest, zmax=widest, colorscale=_DIVERGING)
    for plot in plots:
        add_vehicle(plot, vehicle, roi)
    return plots

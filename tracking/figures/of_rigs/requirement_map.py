"""The ground around the vehicle, and where a rig fails a requirement."""

from __future__ import annotations

import html

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from lidarplace.mounting.vehicle import Vehicle
from lidarplace.placement import Placement
from lidarplace.requirements.judge import Outcome
from tracking.figures.kit.style import VEHICLE_OUTLINE, figure, lidar_colour, text

_MOST_CELLS = 160
"""Along an axis; of more positions a cell shows the worst one."""

_ENOUGH = 0.5
_COLOURS = (
    (0.0, "#7a2b00"),
    (_ENOUGH, "#f0a070"),
    (_ENOUGH, "#a8d4f0"),
    (1.0, "#15619f"),
)
"""Orange is too little, the darker the less; blue is enough, the darker the more."""


def requirement_map(outcome: Outcome, placement: Placement, vehicle: Vehicle) -> go.Figure:
    """What every position has, in terms of what it needs, in the worst of all cases.

    The colours end at nothing and at twice the need. A cross marks the worst position of the worst
    case.
    """
    wanted, worst = outcome.requirement, outcome.worst
    x, y, least = _cells(outcome)
    verdict = "met" if outcome.met else "FAILED"
    title = f"{text(outcome.rig)} · {text(wanted.name)}: {verdict}"
    plot = figure(title, height=_height(x, y))
    plot.add_heatmap(
        x=x,
        y=y,
        z=np.clip(least.T / wanted.least, 0.0, 2.0).astype(np.float32),
        customdata=least.T.astype(np.float32),
        zmin=0.0,
        zmax=2.0,
        colorscale=_COLOURS,
        colorbar={
            "title": {"text": html.escape("of need")},
            "tickvals": [0, 1, 2],
            "ticktext": ["0", "1", "2 ≤"],
            "thickness": 10,
            "x": 1.03,
            "len": 1.0,
        },
        hovertemplate="x %{x:.2f}, y %{y:.2f} m<br>"
        f"%{{customdata:.3g}} {wanted.measure} of {wanted.least:g}<extra></extra>",
        hoverongaps=False,
    )
    _add_vehicle(plot, vehicle)
    _add_lidars(plot, placement)
    plot.add_scatter(
        x=[worst.x],
        y=[worst.y],
        mode="markers",
        marker={
            "symbol": "x",
            "size": 11,
            "color": "#ffffff",
            "line": {"color": "#000000", "width": 1.5},
        },
        hovertext=f"worst: {worst.at_worst:.3g} {wanted.measure}, {text(worst.case)}",
        hoverinfo="text",
        showlegend=False,
    )
    reach = np.concatenate(
        [vehicle.extents[:, :, :2].reshape(-1, 2), [[x[0], y[0]], [x[-1], y[-1]]]]
    )
    (x0, y0), (x1, y1) = reach.min(axis=0) - 0.3, reach.max(axis=0) + 0.3
    plot.update_xaxes(title="x, forward (m)", range=[x0, x1], constrain="domain", showgrid=False)
    plot.update_yaxes(
        title="y, left (m)",
        range=[y0, y1],
        scaleanchor="x",
        constrain="domain",
        showgrid=False,
    )
    return plot


def _cells(
    outcome: Outcome,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Middles of the cells along both axes, and the least in each; NaN where nothing is asked."""
    positions = outcome.positions
    least = np.full(positions.held.shape, np.nan)
    least[positions.held] = np.where(np.isfinite(outcome.least_of), outcome.least_of, np.nan)
    middles = []
    for axis, line in enumerate((positions.x, positions.y)):
        step = -(-len(line) // _MOST_CELLS)
        starts = np.arange(0, len(line), step)
        least = np.fmin.reduceat(least, starts, axis=axis)
        middles.append(np.add.reduceat(line, starts) / np.diff(np.append(starts, len(line))))
    return middles[0], middles[1], least


def _height(x: NDArray[np.float64], y: NDArray[np.float64]) -> int:
    """What fits the shape of the ground in a narrow column."""
    shape = (np.ptp(y) + 2.0) / (np.ptp(x) + 4.0)
    return int(np.clip(98 + 265 * shape, 220, 560))


def _add_vehicle(plot: go.Figure, vehicle: Vehicle) -> None:
    for (x0, y0, _), (x1, y1, _) in vehicle.boxes.tolist():
        plot.add_scatter(
            x=[x0, x1, x1, x0, x0],
            y=[y0, y0, y1, y1, y0],
            **VEHICLE_OUTLINE,
        )
    if vehicle.mesh is not None:
        from_above = vehicle.mesh.vertices[:, :2]
        # What is a line from above has a hull, too, if its points are jiggled.
        outline = from_above[ConvexHull(from_above, qhull_options="QJ").vertices]
        x, y = np.concatenate([outline, outline[:1]]).T
        plot.add_scatter(x=x, y=y, **VEHICLE_OUTLINE)


def _add_lidars(plot: go.Figure, placement: Placement) -> None:
    plot.add_scatter(
        x=[mount.x for mount in placement.mounts],
        y=[mount.y for mount in placement.mounts],
        mode="markers",
        marker={
            "symbol": "diamond",
            "size": 8,
            "color": [lidar_colour(number) for number in range(len(placement.mounts))],
            "line": {"color": "#ffffff", "width": 1},
        },
        hovertext=[
            f"LiDAR {number + 1}, {mount.z:g} m up" for number, mount in enumerate(placement.mounts)
        ],
        hoverinfo="text",
        showlegend=False,
    )

"""The POG seen from above."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.roi import Roi
from tracking.figures.kit.averaged import averaged
from tracking.figures.kit.style import SEQUENTIAL, VEHICLE, VEHICLE_OUTLINE, figure

_CELLS = 200
"""Maps are averaged to at most this many cells along the longer side: a page holds many."""


def pog_from_above(
    entropy: NDArray[np.float32], roi: Roi, title: str, most: int = _CELLS
) -> go.Figure:
    """Entropy of each column of voxels, nats. `entropy` has shape (nx, ny).

    It is averaged to at most `most` cells along the longer side.
    """
    cells, x, y = averaged(entropy, (roi.x, roi.y), most)
    return _map(cells.astype(np.float32), x, y, title, "nats", None, "%{z:.3g} nats")


def vehicle_from_above() -> go.Scatter:
    """Outline of the vehicle, its nose to the right."""
    length, width = VEHICLE
    front = length / 2 - 0.9
    return go.Scatter(
        x=[length / 2, -length / 2, -length / 2, length / 2, length / 2, front, length / 2],
        y=[width / 2, width / 2, -width / 2, -width / 2, width / 2, 0, -width / 2],
        **VEHICLE_OUTLINE,
    )


def add_vehicle(plot: go.Figure) -> None:
    """Outline the vehicle, its nose to the right."""
    plot.add_trace(vehicle_from_above())


def metres(plot: go.Figure, roi: Roi) -> None:
    """Equal scales, x forward to the right, y left upwards; the whole ROI and vehicle in view."""
    reach = VEHICLE[0] / 2 + 0.5
    plot.update_xaxes(
        title="x, forward (m)",
        range=[min(roi.x[0], -reach), max(roi.x[1], reach)],
        constrain="domain",
        showgrid=False,
    )
    plot.update_yaxes(
        title="y, left (m)",
        range=[min(roi.y[0], -1.5), max(roi.y[1], 1.5)],
        scaleanchor="x",
        constrain="domain",
        showgrid=False,
    )


def _map(
    cells: NDArray[np.generic],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    title: str,
    unit: str,
    limits: tuple[float, float] | None,
    hover: str,
) -> go.Figure:
    # The height that fits the map's shape in a narrow column.
    shape = (y[-1] - y[0]) / (x[-1] - x[0])
    plot = figure(title, height=int(np.clip(98 + 265 * shape, 190, 480)))
    low, high = limits or (0.0, float(cells.max()) or 1.0)
    plot.add_heatmap(
        z=cells.T,  # rows of a heat map run along y
        x=x,
        y=y,
        zmin=low,
        zmax=high,
        colorscale=SEQUENTIAL,
        colorbar={"title": {"text": unit}, "thickness": 10, "x": 1.03, "len": 1.0},
        hovertemplate="x %{x:.1f}, y %{y:.1f} m<br>" + hover + "<extra></extra>",
    )
    return plot

"""POG and coverage seen from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.placement import Mount
from lidarplace.roi import Roi
from tracking.figures.style import SEQUENTIAL, VEHICLE, figure

_CELLS = 200
"""Maps are averaged to at most this many cells along the longer side: a page holds many."""


def pog_from_above(
    entropy: NDArray[np.float32], roi: Roi, title: str, most: int = _CELLS
) -> go.Figure:
    """Entropy of each column of voxels, nats. `entropy` has shape (nx, ny).

    It is averaged to at most `most` cells along the longer side.
    """
    cells, x, y = _averaged(entropy, roi, most)
    return _map(cells.astype(np.float32), x, y, title, "nats", None, "%{z:.3g} nats")


def coverage_from_above(
    share: NDArray[np.float32], roi: Roi, title: str, mounts: Sequence[Mount]
) -> go.Figure:
    """Covered share of each column of voxels, 0 to 100 %. `share` has shape (nx, ny), in [0, 1]."""
    cells, x, y = _averaged(share, roi, _CELLS)
    percent = np.rint(100 * cells).astype(np.uint8)
    plot = _map(percent, x, y, title, "%", (0, 100), "%{z} % covered")
    plot.add_scatter(
        x=[mount.x for mount in mounts],
        y=[mount.y for mount in mounts],
        mode="markers",
        marker={"size": 6, "color": "#D55E00", "line": {"color": "#ffffff", "width": 1}},
        hovertemplate="LiDAR at %{x:.2f}, %{y:.2f} m<extra></extra>",
        showlegend=False,
    )
    return plot


def add_vehicle(plot: go.Figure) -> None:
    """Outline the vehicle, its nose to the right."""
    length, width = VEHICLE
    front = length / 2 - 0.9
    plot.add_scatter(
        x=[length / 2, -length / 2, -length / 2, length / 2, length / 2, front, length / 2],
        y=[width / 2, width / 2, -width / 2, -width / 2, width / 2, 0, -width / 2],
        mode="lines",
        line={"color": "#D55E00", "width": 1.5},
        hoverinfo="skip",
        showlegend=False,
    )


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


def _averaged(
    columns: NDArray[np.float32], roi: Roi, most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Means over blocks of columns, and the edges of the blocks along x and y in metres."""
    step = -(-max(columns.shape) // most)
    cells = columns.astype(np.float64)
    edges = []
    for axis, (low, high) in enumerate((roi.x, roi.y)):
        n = columns.shape[axis]
        starts = np.arange(0, n, step)
        size = np.diff(np.append(starts, n))
        cells = np.add.reduceat(cells, starts, axis=axis)
        cells /= size[:, None] if axis == 0 else size
        edges.append(low + (high - low) / n * np.append(starts, n))
    return cells, edges[0], edges[1]

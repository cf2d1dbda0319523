"""The vehicle from above, from its right side (nose to the right) and in 3D, and maps around it.

It is that of the configuration, or the sedan of the clouds where it says none.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.roi import Interval, Roi
from lidarplace.clouds.own_body import sedan
from lidarplace.mounting.outline import outline
from lidarplace.mounting.vehicle import Vehicle, top_near
from lidarplace.rigs.placement import Mount
from lidarplace.viewing.axes import xyz
from lidarplace.viewing.solids import edges
from lidarplace.viewing.vehicle import vehicle_boxes, vehicle_surface
from tracking.figures.kit.style import OUTLINE, SEQUENTIAL, figure

VEHICLE_OUTLINE: dict[str, Any] = {
    "mode": "lines",
    "line": {"color": "#D55E00", "width": 1.5},
    "fill": "toself",
    "fillcolor": "rgba(255, 255, 255, 0.7)",
    "hoverinfo": "skip",
    "showlegend": False,
}
"""Lightens a map under the vehicle: its orange line alone is lost there for some eyes."""


def vehicle_from_above(vehicle: Vehicle | None) -> go.Scatter:
    """x to the right, y upwards."""
    x, y = outline(vehicle or sedan()).T
    return go.Scatter(x=x, y=y, **VEHICLE_OUTLINE)


def vehicle_from_the_side(vehicle: Vehicle | None) -> go.Scatter:
    """x to the right, z upwards."""
    x, z = outline(vehicle or sedan(), (0, 2)).T
    return go.Scatter(x=x, y=z, **VEHICLE_OUTLINE)


def extent_of(vehicle: Vehicle | None) -> NDArray[np.float64]:
    """Lowest and highest corner, metres, shape (2, 3); the origin twice for no body."""
    parts = (vehicle or sedan()).extents
    if not len(parts):
        return np.zeros((2, 3))
    return np.stack([parts[:, 0].min(axis=0), parts[:, 1].max(axis=0)])


def name_of(vehicle: Vehicle | None) -> str:
    """What the lines are of, behind "of"."""
    return "a sedan" if vehicle is None else "the vehicle"


def vehicle_in_space(vehicle: Vehicle | None) -> list[go.Mesh3d | go.Scatter3d]:
    """Traces of a vehicle, none for one without a body."""
    body = vehicle or sedan()
    vertices, faces = vehicle_surface(body)
    if not len(faces):
        return []
    i, j, k = faces.T.copy()
    surface = go.Mesh3d(
        **xyz(vertices),
        i=i,
        j=j,
        k=k,
        color="#aab4be",
        opacity=0.7,
        flatshading=True,
        name="vehicle",
        showlegend=True,
        hoverinfo="skip",
    )
    lines = go.Scatter3d(
        **xyz(edges(vehicle_boxes(body))),
        mode="lines",
        line={"color": OUTLINE, "width": 2},
        hoverinfo="skip",
        showlegend=False,
    )
    return [surface, lines]


def posts(mounts: Sequence[Mount], vehicle: Vehicle | None) -> NDArray[np.float64]:
    """What carries LiDARs above the body: a line up to each, broken by NaN, shape (n, 3)."""
    lines = [np.empty((0, 3))]
    for x, y, z in (mount.position.tolist() for mount in mounts):
        top = top_near(vehicle or sedan(), (x, x), (y, y))
        if top is not None and z > top:
            lines.append(np.array([[x, y, top], [x, y, z], [np.nan] * 3]))
    return np.concatenate(lines)


_AROUND = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.2]])
"""What is in view before and behind the vehicle's ends, metres."""
_CELLS = 200
"""Maps are averaged to at most this many cells along the longer side: a page holds many."""


def pog_from_above(
    entropy: NDArray[np.float32], roi: Roi, title: str, most: int = _CELLS
) -> go.Figure:
    """Entropy of each column of voxels, nats. `entropy` has shape (nx, ny).

    It is averaged to at most `most` cells along the longer side.
    """
    cells, x, y = averaged(entropy, (roi.x, roi.y), most)
    # The height that fits the map's shape in a narrow column.
    shape = (y[-1] - y[0]) / (x[-1] - x[0])
    plot = figure(title, height=int(np.clip(98 + 265 * shape, 190, 480)))
    shown = cells.astype(np.float32)
    plot.add_heatmap(
        z=shown.T,  # rows of a heat map run along y
        x=x,
        y=y,
        zmin=0.0,
        zmax=float(shown.max()) or 1.0,
        colorscale=SEQUENTIAL,
        colorbar={"title": {"text": "nats"}, "thickness": 10, "x": 1.03, "len": 1.0},
        hovertemplate="x %{x:.1f}, y %{y:.1f} m<br>%{z:.3g} nats<extra></extra>",
    )
    return plot


def add_vehicle(plot: go.Figure, vehicle: Vehicle | None, roi: Roi) -> None:
    """Outline the vehicle, a sedan for None; it and the whole ROI are in view.

    Scales are equal, x forward to the right, y left upwards.
    """
    plot.add_trace(vehicle_from_above(vehicle))
    x, y = in_view(vehicle, roi)[:2]
    plot.update_xaxes(title="x, forward (m)", range=x, constrain="domain", showgrid=False)
    plot.update_yaxes(
        title="y, left (m)", range=y, scaleanchor="x", constrain="domain", showgrid=False
    )


def in_view(vehicle: Vehicle | None, roi: Roi) -> list[list[float]]:
    """What axes x, y and z show: the vehicle and the whole ROI, metres."""
    low, high = (extent_of(vehicle) + _AROUND).tolist()
    sides = zip((roi.x, roi.y, roi.z), low, high, strict=True)
    return [[min(side[0], first), max(side[1], last)] for side, first, last in sides]


def averaged(
    cells: NDArray[np.float32], sides: tuple[Interval, Interval], most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Means over blocks of cells.

    Args:
        cells: shape (n, m).
        sides: what the map spans along both axes, metres.
        most: the blocks are square, and so large that no axis has more than these.

    Returns:
        The means, and the edges of the blocks along both axes in metres.
    """
    step = -(-max(cells.shape) // most)
    means = cells.astype(np.float64)
    edges = []
    for axis, (low, high) in enumerate(sides):
        n = cells.shape[axis]
        starts = np.arange(0, n, step)
        size = np.diff(np.append(starts, n))
        means = np.add.reduceat(means, starts, axis=axis)
        means /= size[:, None] if axis == 0 else size
        edges.append(low + (high - low) / n * np.append(starts, n))
    return means, edges[0], edges[1]

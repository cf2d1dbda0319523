"""The vehicle from above, from its right side (nose to the right) and in 3D: that of the
configuration, or a nominal car where it says none."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.mounting.outline import outline
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.viewing.axes import xyz
from lidarplace.viewing.solids import edges
from lidarplace.viewing.vehicle import vehicle_boxes, vehicle_surface
from tracking.figures.kit.style import OUTLINE

VEHICLE_OUTLINE: dict[str, Any] = {
    "mode": "lines",
    "line": {"color": "#D55E00", "width": 1.5},
    "fill": "toself",
    "fillcolor": "rgba(255, 255, 255, 0.7)",
    "hoverinfo": "skip",
    "showlegend": False,
}
"""Lightens a map under the vehicle: its orange line alone is lost there for some eyes."""
_LENGTH, _WIDTH, _HEIGHT = 4.7, 1.9, 1.5
"""Of the nominal car, a middle-class one, metres."""


def vehicle_from_above(vehicle: Vehicle | None) -> go.Scatter:
    """x to the right, y upwards."""
    if vehicle is not None:
        x, y = outline(vehicle).T
        return go.Scatter(x=x, y=y, **VEHICLE_OUTLINE)
    front, half = _LENGTH / 2, _WIDTH / 2
    return go.Scatter(
        x=[front, -front, -front, front, front, front - 0.9, front],
        y=[half, half, -half, -half, half, 0, -half],
        **VEHICLE_OUTLINE,
    )


def vehicle_from_the_side(vehicle: Vehicle | None) -> go.Scatter:
    """x to the right, z upwards."""
    if vehicle is not None:
        x, z = outline(vehicle, (0, 2)).T
        return go.Scatter(x=x, y=z, **VEHICLE_OUTLINE)
    half = _LENGTH / 2
    return go.Scatter(
        x=[-half, -half, -half + 0.3, 0.4, 1.1, half, half, -half],
        y=[0, 0.9, _HEIGHT, _HEIGHT, 0.9, 0.8, 0, 0],
        **VEHICLE_OUTLINE,
    )


def extent_of(vehicle: Vehicle | None) -> NDArray[np.float64]:
    """Lowest and highest corner, metres, shape (2, 3); the origin twice for no body."""
    if vehicle is None:
        half = np.array([_LENGTH / 2, _WIDTH / 2])
        return np.array([[*-half, 0.0], [*half, _HEIGHT]])
    if not len(vehicle.extents):
        return np.zeros((2, 3))
    return np.stack([vehicle.extents[:, 0].min(axis=0), vehicle.extents[:, 1].max(axis=0)])


def name_of(vehicle: Vehicle | None) -> str:
    """What the lines are of, behind "of"."""
    return "a nominal car" if vehicle is None else "the vehicle"


def vehicle_in_space(vehicle: Vehicle | None) -> list[go.Mesh3d | go.Scatter3d]:
    """Traces of a vehicle, none for one without a body; the box around a sedan for None."""
    vertices, faces = vehicle_surface(vehicle)
    if not len(faces):
        return []
    i, j, k = faces.T.copy()
    surface = go.Mesh3d(
        **xyz(vertices),
        i=i,
        j=j,
        k=k,
        color=OUTLINE,
        opacity=0.45,
        flatshading=True,
        name="vehicle",
        showlegend=True,
        hoverinfo="skip",
    )
    lines = go.Scatter3d(
        **xyz(edges(vehicle_boxes(vehicle))),
        mode="lines",
        line={"color": OUTLINE, "width": 2},
        hoverinfo="skip",
        showlegend=False,
    )
    return [surface, lines]

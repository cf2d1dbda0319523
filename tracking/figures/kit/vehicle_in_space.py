"""The vehicle in 3D: its surface, and the edges of its boxes."""

import plotly.graph_objects as go

from lidarplace.mounting.vehicle import Vehicle
from lidarplace.viewing.axes import xyz
from lidarplace.viewing.solids import edges
from lidarplace.viewing.vehicle import vehicle_boxes, vehicle_surface
from tracking.figures.kit.style import OUTLINE


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

"""The vehicle in the layout that plotly reads: its body and its LiDARs."""

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.clouds.shapes import OWN_BODY, between
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement
from lidarplace.viewing import style
from lidarplace.viewing.solids import triangles

Surface = tuple[NDArray[np.floating], NDArray[np.integer]]
"""Vertices (n, 3), metres, and triangles of them (m, 3)."""


def vehicle_boxes(vehicle: Vehicle | None) -> NDArray[np.float64]:
    """Return the boxes of a vehicle, rows of `GEOMETRY`, (m, 7), metres; of a sedan for None."""
    return np.array([OWN_BODY]) if vehicle is None else between(vehicle.boxes)


def vehicle_surface(vehicle: Vehicle | None) -> Surface:
    """Return the boxes and the mesh of a vehicle as triangles; none without a body."""
    vertices, faces = triangles(vehicle_boxes(vehicle))
    if vehicle is None or vehicle.mesh is None:
        return vertices, faces
    of_mesh = vehicle.mesh.faces + len(vertices)
    return np.concatenate([vertices, vehicle.mesh.vertices]), np.concatenate([faces, of_mesh])


def add_lidars(figure: go.Figure, placement: Placement, pointer: float = 0.0) -> None:
    """Add a mark per mount with its pose, and a line of `pointer` metres along its x axis."""
    for i, mount in enumerate(placement.mounts):
        name, shade = f"LiDAR {i + 1}", style.COLOURS[i % len(style.COLOURS)]
        roll, pitch, yaw = np.degrees([mount.roll, mount.pitch, mount.yaw]) + 0.0
        ends = np.stack([mount.position, mount.position + pointer * mount.rotation[:, 0]])
        figure.add_scatter3d(
            **dict(zip("xyz", (ends if pointer else ends[:1]).T, strict=True)),
            mode="lines+markers" if pointer else "markers",
            marker={"size": [4, 0] if pointer else 4, "color": shade, "symbol": "diamond"},
            line={"color": shade, "width": 4},
            hovertext=f"{name}: x {mount.x:g}, y {mount.y:g}, z {mount.z:g} m<br>"
            f"roll {roll:.1f}°, pitch {pitch:.1f}°, yaw {yaw:.1f}°",
            hoverinfo="text",
            name=name,
            legendgroup=name,
            showlegend=bool(pointer),
        )

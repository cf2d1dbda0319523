"""The body of the vehicle as boxes and as one surface, in the layout that plotly reads."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.shapes import OWN_BODY
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.viewing.solids import between, triangles

Surface = tuple[NDArray[np.floating], NDArray[np.integer]]
"""Vertices (n, 3), metres, and triangles of them (m, 3)."""


def vehicle_boxes(vehicle: Vehicle | None) -> NDArray[np.float64]:
    """Its boxes, rows of `lidarplace.logs.boxes.GEOMETRY`, shape (m, 7), metres; that around a
    sedan for None."""
    return np.array([OWN_BODY]) if vehicle is None else between(vehicle.boxes)


def vehicle_surface(vehicle: Vehicle | None) -> Surface:
    """Its boxes and its mesh; nothing of a vehicle without a body."""
    vertices, faces = triangles(vehicle_boxes(vehicle))
    if vehicle is None or vehicle.mesh is None:
        return vertices, faces
    of_mesh = vehicle.mesh.faces + len(vertices)
    return np.concatenate([vertices, vehicle.mesh.vertices]), np.concatenate([faces, of_mesh])

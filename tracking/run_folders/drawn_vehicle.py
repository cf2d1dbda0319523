"""The vehicle of a sweep or a search in its file of JSON, to be drawn."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, model_validator

from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.vehicle import Vehicle
from tracking.run_folders.json_file import Part

Point = tuple[float, float, float]

MOST_DRAWN, FINEST_M = 5000, 0.02
"""Triangles of a mesh in a picture, and how far corners are moved at first to have no more."""


class Triangles(Part):
    """A surface: corners in metres, and which three of them a triangle has."""

    vertices: tuple[Point, ...]
    faces: tuple[tuple[int, int, int], ...]

    @classmethod
    def of(cls, mesh: Mesh | None) -> Triangles | None:
        """What a picture shows of a mesh: at most `MOST_DRAWN` triangles."""
        if mesh is None:
            return None
        edge = FINEST_M
        while len(mesh.faces) > MOST_DRAWN and edge < 1.0:
            mesh, edge = mesh.coarse(edge), 2 * edge
        return cls(vertices=mesh.vertices.round(3).tolist(), faces=mesh.faces.tolist())

    @property
    def mesh(self) -> Mesh:
        """The surface."""
        return Mesh(np.array(self.vertices), np.array(self.faces))

    @model_validator(mode="after")
    def _possible(self) -> Triangles:
        corners = {corner for face in self.faces for corner in face}
        if not corners <= set(range(len(self.vertices))):
            raise ValueError(f"faces: there are {len(self.vertices)} vertices")
        _ = self.mesh  # which has an area
        return self


def _possible(boxes: tuple[tuple[Point, Point], ...]) -> tuple[tuple[Point, Point], ...]:
    Vehicle("vehicle", np.array(boxes))
    return boxes


Boxes = Annotated[tuple[tuple[Point, Point], ...], AfterValidator(_possible)]
"""Lowest and highest corner of each, metres, ego frame."""


def drawn_vehicle(boxes: Boxes, mesh: Triangles | None) -> Vehicle:
    """The vehicle that pictures show."""
    return Vehicle("vehicle", np.array(boxes), None if mesh is None else mesh.mesh)

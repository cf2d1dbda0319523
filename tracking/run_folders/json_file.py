"""JSON file with the result of a sweep or a search: written from its model, and read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, ClassVar, Self, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError, model_validator

from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import Length, fault
from lidarplace.files.atomic import replacing
from lidarplace.files.regular import regular
from lidarplace.mounting.mesh import Mesh
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.scenes.site import Obstacles, Poles


class Part(BaseModel):
    """Part of a result file: frozen; keys that a page does not show are ignored."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)


Model = TypeVar("Model", bound=Part)


class ResultFile(Part):
    """Whole of a result file."""

    FILE: ClassVar[str]

    def write(self, folder: Path) -> None:
        """Write the keys that were given in one step; null for NaN and infinity."""
        plain = json.loads(self.model_dump_json(by_alias=True, exclude_unset=True))
        with replacing(folder / self.FILE) as partial:
            partial.write_text(json.dumps(plain, indent=1), encoding="utf-8")

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the file in `folder`; raises as `read_result_file`."""
        return read_result_file(folder / cls.FILE, cls)


def read_result_file(path: Path, model: type[Model]) -> Model:
    """Read `path`. Raises ValueError, one line that names the file and the key, or OSError."""
    try:
        return model.model_validate_json(regular(path).read_bytes())
    except ValidationError as error:
        raise fault(error, str(path)) from None


Point = tuple[float, float, float]

MOST_DRAWN, FINEST_M = 5000, 0.02
"""Triangles of a mesh in a picture, and how far corners are moved at first to have no more."""


class Triangles(Part):
    """Surface: corners in metres, and which three of them a triangle has."""

    vertices: tuple[Point, ...]
    faces: tuple[tuple[int, int, int], ...]

    @classmethod
    def of(cls, mesh: Mesh | None) -> Triangles | None:
        """Simplify a mesh for pictures to at most `MOST_DRAWN` triangles."""
        if mesh is None:
            return None
        edge = FINEST_M
        while len(mesh.faces) > MOST_DRAWN and edge < 1.0:
            mesh, edge = mesh.coarse(edge), 2 * edge
        return cls(vertices=mesh.vertices.round(3).tolist(), faces=mesh.faces.tolist())

    @property
    def mesh(self) -> Mesh:
        """Surface as a mesh."""
        return Mesh(np.array(self.vertices), np.array(self.faces))

    @model_validator(mode="after")
    def _possible(self) -> Triangles:
        corners, most = {corner for face in self.faces for corner in face}, len(self.vertices) - 1
        if unknown := corners - set(range(most + 1)):
            raise InputError(key="faces", expected=f"vertices 0 to {most}", found=min(unknown))
        _ = self.mesh  # which has an area
        return self


def _possible(boxes: tuple[tuple[Point, Point], ...]) -> tuple[tuple[Point, Point], ...]:
    Vehicle("vehicle", np.array(boxes))
    return boxes


Boxes = Annotated[tuple[tuple[Point, Point], ...], AfterValidator(_possible)]
"""Lowest and highest corner of each box, metres, ego frame."""


Building = tuple[Length, Length, Length, Length, Length, Length, Length]
Lane = tuple[Length, Length, Length, Length, Length]


class Surroundings(Part):
    """Buildings and lanes around a site that pictures show, in its frame; metres, radians."""

    buildings: tuple[Building, ...]  # x, y, z, length, width, height, yaw
    lanes: tuple[Lane, ...]  # x, y, yaw, half of the length, half of the width

    @classmethod
    def of(cls, vehicle: Vehicle | None) -> Surroundings | None:
        """Write what is around poles to the millimetre; None for a vehicle."""
        if not isinstance(vehicle, Poles):
            return None
        buildings, lanes = vehicle.around.buildings, vehicle.around.lanes
        return cls(buildings=buildings.round(3).tolist(), lanes=lanes.round(3).tolist())

    @property
    def obstacles(self) -> Obstacles:
        """Buildings and lanes as arrays."""
        rows = ((self.buildings, 7), (self.lanes, 5))
        return Obstacles(*(np.array(each, np.float64).reshape(-1, n) for each, n in rows))


def drawn_vehicle(
    boxes: Boxes, mesh: Triangles | None, site: Surroundings | None = None
) -> Vehicle:
    """Make the vehicle that pictures show, or the poles of a site."""
    if site is not None:
        return Poles("site", np.array(boxes), around=site.obstacles)
    return Vehicle("vehicle", np.array(boxes), None if mesh is None else mesh.mesh)

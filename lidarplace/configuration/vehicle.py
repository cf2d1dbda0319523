"""The body of the vehicle in a configuration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, Strict, model_validator

from lidarplace.base.errors import InputError
from lidarplace.base.optional import needs
from lidarplace.configuration.settings import Degrees, FileBeside, Length, Settings, validated
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.mounting.mesh_file import read_mesh
from lidarplace.mounting.trailer import BendingVehicle
from lidarplace.mounting.vehicle import Vehicle, with_keep_outs
from lidarplace.rigs.pose import rotation

Corner = tuple[Length, Length, Length]
_LARGEST_RADIANS = 2.1
"""The largest angle of a trailer, 120 degrees, in radians; articulation of few degrees is none."""


def _check_above_ground(boxes: Sequence[tuple[Corner, Corner]]) -> None:
    top = max((z for box in boxes for _, _, z in box), default=math.inf)
    if top <= 0:
        expected = "a top above the ground, z > 0"
        raise InputError("is all under ground", key="boxes", expected=expected, found=top)


class TrailerSettings(Settings):
    """A trailer that turns about its hitch.

    Requirements and constraints hold at each angle and straight; clouds and detectors see it
    straight. No LiDAR may sit on it."""

    hitch: tuple[Length, Length] = Field(description="x and y of the axis about which it turns, m")
    boxes: tuple[tuple[Corner, Corner], ...] = Field(
        min_length=1, description="as those of the vehicle, when it is straight"
    )
    angles_deg: tuple[Annotated[Degrees, Field(ge=-120, le=120)], ...] = Field(
        min_length=1,
        max_length=24,
        description="counter-clockwise as seen from above: at 60 its end is on the right; one of "
        f"them beyond ±{_LARGEST_RADIANS}, or all 0",
    )

    @model_validator(mode="after")
    def _plausible(self) -> TrailerSettings:
        largest = max(map(abs, self.angles_deg))
        if 0 < largest <= _LARGEST_RADIANS:
            fix = f"write {math.degrees(largest):.4g} for {largest:g} radians"
            text = f"at most {largest:g}, as in radians"
            raise InputError(key="angles_deg", expected="degrees", found=text, fix=fix)
        _check_above_ground(self.boxes)
        return self


class VehicleSettings(Settings):
    """Body that stops rays and may not contain a LiDAR: boxes, a mesh, or both.

    A list is short for `boxes`, a text for `mesh`."""

    boxes: tuple[tuple[Corner, Corner], ...] = Field(
        (), description="[[x0, y0, z0], [x1, y1, z1]]: lower and upper corner, metres, ego frame"
    )
    mesh: FileBeside | None = Field(
        None,
        description="file of triangles: STL, OBJ, PLY, glTF; relative to the folder of the "
        "configuration",
    )
    scale: Annotated[float, Strict(), Field(gt=0, le=1000, allow_inf_nan=False)] = Field(
        1.0, description="metres per unit of the mesh: 0.001 for millimetres"
    )
    roll_deg: Degrees = Field(
        0.0, description="rotation of the mesh, as of a mount; 90: its y axis is up"
    )
    pitch_deg: Degrees = Field(0.0, description="the same, after roll")
    yaw_deg: Degrees = Field(0.0, description="the same, after pitch; 180: its x axis is back")
    origin: Corner = Field(
        (0.0, 0.0, 0.0), description="where the origin of the mesh is in the ego frame, metres"
    )

    trailer: TrailerSettings | None = Field(
        None, description="a trailer that turns about its hitch"
    )

    keep_out: tuple[tuple[Corner, Corner], ...] = Field(
        (),
        description="further boxes that stop rays and may not contain a LiDAR, from which areas "
        "around the vehicle are not measured, such as mirrors",
    )

    @model_validator(mode="after")
    def _possible(self) -> VehicleSettings:
        of_mesh = self.model_fields_set - {"boxes", "mesh", "trailer", "keep_out"}
        if self.mesh is None and of_mesh:
            raise InputError("needs mesh", key=min(of_mesh))
        self.vehicle()
        _check_above_ground(self.boxes)
        return self

    def vehicle(self) -> Vehicle:
        """Build the vehicle.

        Raises ValueError as `Vehicle` and `read_mesh`; also if the file cannot be read."""
        if self.mesh is None:
            return _vehicle(self, 0, 0)
        try:
            status = self.mesh.stat()
            return _vehicle(self, status.st_mtime_ns, status.st_size)
        except OSError as error:
            raise InputError(f"{self.mesh}: {error.strerror}", key="mesh") from None
        except ModuleNotFoundError as error:
            raise InputError(str(needs(error) or error), key="mesh") from None


@lru_cache(maxsize=8)
def _vehicle(settings: VehicleSettings, changed: int, size: int) -> Vehicle:
    mesh, trailer = None, settings.trailer
    if settings.mesh is not None:
        angles = map(math.radians, (settings.roll_deg, settings.pitch_deg, settings.yaw_deg))
        mesh = read_mesh(settings.mesh, settings.scale, rotation(*angles), settings.origin)
    body = Vehicle("vehicle", np.array(settings.boxes), mesh)
    if trailer is not None:
        boxes, number = np.array([*trailer.boxes, *settings.boxes]), len(trailer.boxes)
        body = BendingVehicle("vehicle", boxes, mesh, number, trailer.hitch, trailer.angles_deg)
    return with_keep_outs(body, Vehicle("keep_out", np.array(settings.keep_out)).boxes)


def _short(value: Any) -> Any:
    if isinstance(value, str):
        return {"mesh": value}
    return {"boxes": value} if isinstance(value, (list, tuple)) else value


OwnVehicle = Annotated[VehicleSettings, BeforeValidator(_short)] | None
"""A field of a model; null is a car."""


def vehicle_of(settings: VehicleSettings | None) -> Vehicle:
    """Return the vehicle of a field: a car if it is null."""
    return Vehicle.car() if settings is None else settings.vehicle()


def read_vehicle(path: Path) -> Vehicle | None:
    """Read the vehicle in a file: YAML of what a field holds, or a mesh in metres.

    Raises OSError: the file cannot be read; ValueError: it holds no vehicle."""
    raw = read_yaml_file(path) if path.suffix in (".yaml", ".yml") else path.name
    field: Any = OwnVehicle
    settings: VehicleSettings | None = validated(field, raw, str(path), path.parent)
    return None if settings is None else settings.vehicle()

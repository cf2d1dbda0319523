"""The body of the vehicle in a configuration."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from lidarplace.configuration.settings import Length, Settings
from lidarplace.mounting.vehicle import Vehicle

Corner = tuple[Length, Length, Length]


class VehicleSettings(Settings):
    """A body that stops rays, and in which no LiDAR may sit; a list is short for `boxes`."""

    boxes: tuple[tuple[Corner, Corner], ...] = Field(
        (), description="[[x0, y0, z0], [x1, y1, z1]]: lower and upper corner, metres, ego frame"
    )

    @model_validator(mode="after")
    def _possible(self) -> VehicleSettings:
        self.vehicle()
        return self

    def vehicle(self) -> Vehicle:
        """In the terms of `lidarplace`. Raises ValueError as `Vehicle` does."""
        return Vehicle("vehicle", np.array(self.boxes))


def _short(value: Any) -> Any:
    return {"boxes": value} if isinstance(value, (list, tuple)) else value


OwnVehicle = Annotated[VehicleSettings, BeforeValidator(_short)] | None
"""A field of a model; null is a car."""


def vehicle_of(settings: VehicleSettings | None) -> Vehicle:
    """The vehicle of a field: a car if it is null."""
    return Vehicle.car() if settings is None else settings.vehicle()

"""The body of the vehicle in a configuration: boxes, or a car."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from lidarplace.configuration.settings import Length
from lidarplace.mounting.vehicle import Vehicle


def _car(boxes: Any) -> Any:
    return Vehicle.car().boxes.tolist() if boxes is None else boxes


Corner = tuple[Length, Length, Length]

VehicleBoxes = Annotated[
    tuple[tuple[Corner, Corner], ...],
    BeforeValidator(_car),
    Field(validate_default=True, description="boxes [[x0, y0, z0], [x1, y1, z1]]; a car if null"),
]
"""A field of a model; its default is null."""

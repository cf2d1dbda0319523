"""Zones and LiDAR models of a search, and LiDARs with a fixed mount."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from lidarplace.base.errors import InputError
from lidarplace.configuration.mounting import PlaceSettings, number_as_interval, ordered
from lidarplace.configuration.placement import MountSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import Amount, Count, Degrees, Name
from lidarplace.rigs.catalogue.datasheet import datasheet

Turn = Annotated[
    tuple[Degrees, Degrees], BeforeValidator(number_as_interval), AfterValidator(ordered)
]
"""A range of an angle: a number, or [min, max]."""
_OF_COUNTED_ZONES = {"models", "mirrored", "facing_deg", "roll_deg", "pitch_deg", "yaw_deg"}
"""Keys that differ between zones, whose LiDARs then have parameters of their own."""


class ZoneSettings(PlaceSettings):
    """A zone where a LiDAR may be mounted: a box, or a polygon with heights; metres, ego frame."""

    lidars: Annotated[tuple[Count, Count], BeforeValidator(number_as_interval)] | None = Field(
        None, description="number of LiDARs in it, or [min, max]; set it for all zones or for none"
    )
    models: Annotated[tuple[Name, ...], Field(min_length=1)] | None = Field(
        None, description="allowed models of `search.models`, all by default; needs `lidars`"
    )
    mirrored: bool = Field(
        False,
        description="each of its LiDARs has a mirror image right of y = 0, and the two count as "
        "one; needs `lidars`",
    )
    facing_deg: Degrees = Field(
        0.0, description="heading that yaw_deg is relative to: 45 faces the front left"
    )
    roll_deg: Turn | None = Field(None, description="in place of search.roll_deg; with `lidars`")
    pitch_deg: Turn | None = Field(None, description="in place of search.pitch_deg; with `lidars`")
    yaw_deg: Turn | None = Field(
        None, description="in place of search.yaw_deg, from facing_deg; with `lidars`"
    )
    price: Amount = Field(
        0.0, description="price of a mount in this zone, in addition to its LiDAR"
    )

    @model_validator(mode="after")
    def _possible(self) -> ZoneSettings:
        if self.lidars is None:
            if keys := self.model_fields_set & _OF_COUNTED_ZONES:
                raise InputError("needs `lidars` in the zone", key=min(keys))
        elif self.lidars[0] > self.lidars[1]:
            raise InputError(key="lidars", expected="a number, or [min, max] with min <= max")
        if self.mirrored and any(y < 0 for _, y in self.zone("any").polygon):
            raise InputError("define only the part left of y = 0", key="mirrored")
        return self


class ModelSettings(SensorSettings):
    """A LiDAR model that may be chosen."""

    price: Amount = Field(0.0, description="in any currency")
    power: Amount | None = Field(None, description="watts; those of the catalogue if null")

    @property
    def watts(self) -> float:
        """Power in watts; NaN where neither the configuration nor the catalogue has it."""
        power = datasheet(self.name).power_w if self.power is None and self.name else self.power
        return math.nan if power is None else power


class FixedSettings(MountSettings):
    """A LiDAR with a fixed mount; metres and radians as in `placements`."""

    model: Name | None = Field(None, description="name in `models`; the first one by default")

"""Zones of a configuration with numbers of LiDARs, models and angles of their own."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from lidarplace.base.errors import InputError
from lidarplace.configuration.mounting import PlaceSettings, Span, number_as_interval, ordered
from lidarplace.configuration.settings import Count, Degrees, Name, Price, Settings
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.mounting.zone import Zone

Turn = Annotated[
    tuple[Degrees, Degrees], BeforeValidator(number_as_interval), AfterValidator(ordered)
]
"""A range of an angle: a number, or [min, max]."""
CountRange = Annotated[
    tuple[Count, Count], BeforeValidator(number_as_interval), AfterValidator(ordered)
]
"""A range of a number of LiDARs: a number, or [min, max]."""


def _named(value: Any) -> Any:
    return {name: {} for name in value} if isinstance(value, (list, tuple)) else value


class AngleSettings(Settings):
    """Angles in place of those of the search, or of the zone."""

    roll_deg: Turn | None = Field(None, description="in place of search.roll_deg")
    pitch_deg: Turn | None = Field(None, description="in place of search.pitch_deg")
    yaw_deg: Turn | None = Field(None, description="in place of search.yaw_deg, from facing_deg")


class ZoneSettings(PlaceSettings, AngleSettings):
    """A zone where a LiDAR may be mounted: a box, or a polygon with heights; metres, ego frame."""

    kerb: Span | None = Field(
        None,
        description="a number or [min, max], metres beside lanes: strips along all kerbs within x "
        "and y, by default the ROI, on no lane and in no building; for sites of simulated traffic",
    )
    lidars: CountRange | None = Field(
        None, description="number of LiDARs in it, or [min, max]; null: as many as search.lidars"
    )
    models: (
        Annotated[dict[Name, AngleSettings], BeforeValidator(_named), Field(min_length=1)] | None
    ) = Field(
        None,
        description="allowed models of `search.models`, all by default: their names, or name -> "
        "angles in place of those of the zone",
    )
    mirrored: bool = Field(
        False,
        description="each of its LiDARs has a mirror image right of y = 0; in `lidars` of the zone "
        "the two count as one",
    )
    facing_deg: Degrees = Field(
        0.0, description="heading that yaw_deg is relative to: 45 faces the front left"
    )
    price: Price = Field(0.0, description="price of a mount in this zone, in addition to its LiDAR")

    @field_validator("kerb", mode="before")
    @classmethod
    def _of_a_site(cls, kerb: Any) -> None:
        """Reject kerbs that no strips have replaced (`lidarplace.scenes.kerbs`)."""
        if kerb is not None:
            raise InputError("only a site has kerbs", fix="set site, or remove it")

    @model_validator(mode="after")
    def _possible(self) -> ZoneSettings:
        if self.mirrored and any(y < 0 for _, y in self.zone("any").polygon):
            raise InputError("define only the part left of y = 0", key="mirrored")
        return self

    def zones(self, name: str, vehicle: Vehicle) -> tuple[Zone, ...]:
        """Build the zone, cut off above the vehicle, and its mirror image if it has one."""
        zone = self.within_standoff(name, vehicle)
        image = replace(zone, polygon=tuple((x, 0 - y) for x, y in zone.polygon))
        return (zone, image) if self.mirrored else (zone,)

    @property
    def size(self) -> int:
        """LiDARs that count as one: two of a mirrored pair."""
        return 2 if self.mirrored else 1

    @property
    def has_kinds(self) -> bool:
        """Whether its LiDARs differ from those of other zones: their number, models or angles."""
        keys = {"lidars", "models", "mirrored", "facing_deg", *AngleSettings.model_fields}
        return bool(self.model_fields_set & keys)

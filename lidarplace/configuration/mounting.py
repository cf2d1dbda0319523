"""Limits of mounting in a configuration: zones, keep-outs, limits, and errors of mounts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import (
    Amount,
    Aside,
    Count,
    CountFromOne,
    Degrees,
    Distance,
    Height,
    Length,
    Name,
    Price,
    Probability,
    Settings,
)
from lidarplace.configuration.vehicle import VehicleSettings
from lidarplace.mounting.common_view import CommonView
from lidarplace.mounting.errors import MountingErrors
from lidarplace.mounting.limits import Limits
from lidarplace.mounting.polygon import NANOMETRE
from lidarplace.mounting.vehicle import Vehicle, top_near
from lidarplace.mounting.zone import Zone

Pair = tuple[Length, Length]


def ordered(interval: tuple[float, float]) -> tuple[float, float]:
    """Return the interval; raise ValueError if its ends are the wrong way round."""
    if interval[0] > interval[1]:
        raise InputError(expected="a number, or [min, max] with min <= max")
    return interval


def number_as_interval(value: Any) -> Any:
    """Turn a number into the interval that holds it alone."""
    return [value, value] if isinstance(value, (int, float)) else value


Span = Annotated[tuple[Aside, Aside], BeforeValidator(number_as_interval), AfterValidator(ordered)]
"""A number, or [min, max]."""
Heights = Annotated[
    tuple[Height, Height], BeforeValidator(number_as_interval), AfterValidator(ordered)
]


class PlaceSettings(Settings):
    """Zone in which a LiDAR may be mounted: a box, or a polygon with heights; metres, ego frame."""

    x: Span | None = Field(None, description="a number or [min, max], metres")
    y: Span | None = Field(None, description="a number or [min, max], metres")
    polygon: tuple[tuple[Aside, Aside], ...] | None = Field(
        None, description="corners [x, y], instead of x and y"
    )
    z: Heights = Field(description="a number or [min, max], metres")
    standoff: Distance | None = Field(
        0.3,
        description="largest height above the vehicle's body, metres: higher parts of the zone "
        "are cut off; null: as far as z says, on a rack",
    )

    @model_validator(mode="after")
    def _has_a_shape(self) -> PlaceSettings:
        sides = [self.x is not None, self.y is not None]
        if not (all(sides) if self.polygon is None else not any(sides)):
            raise ValueError("a zone needs x, y and z, or polygon and z")
        self.zone("any")
        return self

    def zone(self, name: str) -> Zone:
        """Build the zone; raise ValueError if its shape is impossible."""
        if self.polygon is not None:
            return Zone(name, self.polygon, self.z)
        assert self.x is not None
        assert self.y is not None
        return Zone.box(name, self.x, self.y, self.z)

    def within_standoff(self, name: str, vehicle: Vehicle) -> Zone:
        """Cut off the part of the zone that is too far above the body beneath it.

        Raises ValueError: there is none; says what to write."""
        zone = self.zone(name)
        ys = [y for _, y in zone.polygon]
        top = top_near(vehicle, zone.x, (min(ys), max(ys)))
        if self.standoff is None or top is None:
            return zone
        (low, high), most = zone.z, top + self.standoff
        if high <= most + NANOMETRE:
            return zone
        if low > most + NANOMETRE:
            limit = f"{self.standoff:g} m, above the vehicle's body, {top:g} m there"
            needed = math.ceil(100 * (high - top) - NANOMETRE) / 100
            raise InputError(
                f"z from {low:g} m is more than the standoff, {limit}",
                key=f"zones.{name}",
                fix=f"write z up to {most:g}, or with a rack standoff: {needed:g}",
            )
        return replace(zone, z=(low, max(low, most)))


def mountable(zones: Mapping[str, PlaceSettings], vehicle: Vehicle) -> tuple[Zone, ...]:
    """Build the zones, cut off where they are too far above the vehicle.

    Raises ValueError: one is all off."""
    return tuple(zone.within_standoff(name, vehicle) for name, zone in zones.items())


class KeepOutSettings(Settings):
    """A box that may not contain a LiDAR and hides objects, such as a window or a mirror."""

    x: Pair = Field(description="[min, max], metres")
    y: Pair = Field(description="[min, max], metres")
    z: Pair = Field(description="[min, max], metres")

    @model_validator(mode="after")
    def _has_volume(self) -> KeepOutSettings:
        if not all(low < high for low, high in (self.x, self.y, self.z)):
            raise InputError(expected="[min, max] with min < max along x, y and z")
        return self


KeepOuts = Annotated[
    dict[Name, KeepOutSettings],
    Field(description="regions by name: no LiDAR may be inside, and they hide objects behind them"),
]


def keep_out_boxes(keep_out: Mapping[str, KeepOutSettings]) -> NDArray[np.float64]:
    """Return lower and upper corners, metres, shape (n, 2, 3)."""
    sides = [(box.x, box.y, box.z) for box in keep_out.values()]
    return np.array(sides, np.float64).reshape(-1, 3, 2).transpose(0, 2, 1)


def carrier_of(
    vehicle: VehicleSettings | None, keep_out: Mapping[str, KeepOutSettings]
) -> VehicleSettings | None:
    """Return the vehicle, a car by default, with keep-outs as a part of it; None for neither."""
    if not keep_out:
        return vehicle
    body = vehicle or VehicleSettings.model_validate({"boxes": Vehicle.car().boxes.tolist()})
    boxes = (tuple(zip(box.x, box.y, box.z, strict=True)) for box in keep_out.values())
    return body.model_copy(update={"keep_out": (*body.keep_out, *boxes)})


class CommonViewSettings(Settings):
    """Common view that pairs of sensors need, for their calibration against each other."""

    pairs: str | tuple[tuple[CountFromOne, CountFromOne], ...] = Field(
        "chain",
        description="all: every pair; chain: enough pairs to connect all sensors; or a list of "
        "pairs, numbers from 1, such as [[1, 2], [2, 3]]",
    )
    share: Probability = Field(
        gt=0,
        description="smallest share of the smaller field of view that both see past the vehicle",
    )
    range: Distance = Field(20.0, gt=0, description="distance at which views are compared, metres")

    @field_validator("pairs", mode="before")
    @classmethod
    def _known(cls, pairs: Any) -> Any:
        listed = isinstance(pairs, (list, tuple)) and all(
            isinstance(pair, (list, tuple)) and len(pair) == 2 and pair[0] != pair[1]
            for pair in pairs
        )
        if pairs not in ("all", "chain") and not (listed and pairs):
            raise InputError(expected="all, chain or pairs of two LiDARs, such as [[1, 2], [2, 3]]")
        return pairs

    def view(self) -> CommonView:
        """Return the common view in the terms of `lidarplace`."""
        if isinstance(self.pairs, str):
            return CommonView("all" if self.pairs == "all" else "chain", self.share, self.range)
        pairs = tuple((min(pair) - 1, max(pair) - 1) for pair in self.pairs)
        return CommonView(pairs, self.share, self.range)


class LimitSettings(Settings):
    """Limits of a placement."""

    distance: Distance = Field(0.2, description="smallest distance between LiDARs, metres; 0: any")
    body_share: Probability | None = Field(
        None, description="largest share of a LiDAR's rays that may meet the vehicle's own body"
    )
    price: Price | None = Field(None, description="maximum price of all LiDARs")
    power: Amount | None = Field(None, description="maximum power of all LiDARs, watts")
    common_view: CommonViewSettings | None = Field(
        None, description="common view of the LiDARs, for their calibration against each other"
    )
    facing: Count | None = Field(
        None, description="largest number of pairs of LiDARs that may face each other"
    )

    def limits(
        self, body: Vehicle, keep_out: NDArray[np.float64], zones: Sequence[Zone] = ()
    ) -> Limits:
        """Return the limits of mounting; arguments as in `Limits`."""
        common = None if self.common_view is None else self.common_view.view()
        return Limits(zones, body, keep_out, self.distance, self.body_share, common, self.facing)


class OffsetSettings(Settings):
    """Largest errors of mounts."""

    offset: Distance = Field(0.0, description="metres at most, along each axis")
    angle_deg: Annotated[Degrees, Field(ge=0)] = Field(
        0.0, description="degrees at most, about each axis"
    )

    def errors(self) -> MountingErrors:
        """Build the mounting errors."""
        return MountingErrors(self.offset, math.radians(self.angle_deg))


class MountingErrorSettings(OffsetSettings):
    """Errors of mounts in simulated clouds: each frame has another vehicle of a fleet."""

    vehicle: Count | None = Field(
        None,
        description="test frames are all of this vehicle of the fleet; trainings do not depend on "
        "it",
    )

    @model_validator(mode="after")
    def _differ(self) -> MountingErrorSettings:
        if self.vehicle is not None and not self.errors():
            raise InputError("has no effect without offset or angle_deg", key="vehicle")
        return self


REAL_MOUNTS = MountingErrorSettings(offset=0.01, angle_deg=0.5)
"""Errors of mounts on real vehicles, the default of searches and of what follows from them."""

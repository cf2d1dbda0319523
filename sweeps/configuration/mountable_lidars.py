"""LiDAR models of a search, and LiDARs with a fixed mount."""

from __future__ import annotations

import math

from pydantic import Field

from lidarplace.configuration.placement import MountSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import Amount, Name, Price
from lidarplace.configuration.zones import CountRange
from lidarplace.rigs.catalogue.datasheet import datasheet


class ModelSettings(SensorSettings):
    """A LiDAR model that may be chosen."""

    count: CountRange | None = Field(
        None, description="number of LiDARs of it in a rig, or [min, max]; null: any"
    )
    price: Price | None = Field(None, description="in any currency")
    power: Amount | None = Field(None, description="watts; those of the catalogue if null")

    @property
    def watts(self) -> float:
        """Power in watts; NaN where neither the configuration nor the catalogue has it."""
        power = datasheet(self.name).power_w if self.power is None and self.name else self.power
        return math.nan if power is None else power

    def total(self, name: str) -> float:
        """Return `price` or `power`; NaN where it is not known."""
        price = math.nan if self.price is None else self.price
        return {"price": price, "power": self.watts}[name]


class FixedSettings(MountSettings):
    """A LiDAR with a fixed mount; metres and radians as in `placements`."""

    model: Name | None = Field(None, description="name in `models`; the first one by default")

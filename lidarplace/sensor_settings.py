"""A LiDAR model in a configuration: degrees and metres."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from lidarplace.sensor import Lidar

Finite = Annotated[float, Field(allow_inf_nan=False)]


class SensorSettings(BaseModel):
    """A LiDAR model; the defaults are the paper's, without noise."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    beams: int = Field(16, ge=1, description="beams, evenly spread over elevation_deg")
    elevation_deg: tuple[Finite, Finite] = Field(
        (-25.0, 5.0), description="elevation of the lowest and the highest beam, degrees"
    )
    elevations_deg: tuple[Finite, ...] | None = Field(
        None, description="elevation of every beam, degrees, in place of the two keys above"
    )
    azimuth_steps: int = Field(5625, ge=1, description="firings of a beam in one turn")
    range: float = Field(100.0, gt=0, allow_inf_nan=False, description="farthest return, metres")
    range_noise: float = Field(0.0, ge=0, allow_inf_nan=False, description="standard deviation, m")
    drop_off: float = Field(0.0, ge=0, lt=1, description="probability that a return is lost")
    azimuth_deg: tuple[Finite, Finite] = Field(
        (-180.0, 180.0),
        description="horizontal field of view [min, max] in the sensor's frame, degrees; 0 is its "
        "x axis, growing to the left, and the interval may cross 180",
    )

    @field_validator("azimuth_deg")
    @classmethod
    def _at_most_one_turn(cls, interval: tuple[float, float]) -> tuple[float, float]:
        if not 0 < interval[1] - interval[0] <= 360:
            raise ValueError("allowed is [min, max] with min < max and max - min <= 360")
        return interval

    @model_validator(mode="after")
    def _build(self) -> SensorSettings:
        if self.elevations_deg is not None and (self.model_fields_set & {"beams", "elevation_deg"}):
            raise ValueError("elevations_deg replaces beams and elevation_deg; name one or the two")
        self.lidar()
        return self

    def lidar(self) -> Lidar:
        """The sensor in radians."""
        degrees = self.elevations_deg
        if degrees is None:
            low, high = self.elevation_deg
            step = (high - low) / (self.beams - 1) if self.beams > 1 else 0.0
            degrees = tuple(low + i * step for i in range(self.beams))
        return Lidar(
            tuple(math.radians(e) for e in degrees),
            self.azimuth_steps,
            self.range,
            self.range_noise,
            self.drop_off,
            (math.radians(self.azimuth_deg[0]), math.radians(self.azimuth_deg[1])),
        )

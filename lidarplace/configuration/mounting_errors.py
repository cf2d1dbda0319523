"""How far mounts are off, in the configuration of a sweep, a search or a requirement."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from lidarplace.configuration.settings import Count, Degrees, Distance, Settings
from lidarplace.mounting.errors import MountingErrors


class OffsetSettings(Settings):
    """How far mounts are off."""

    offset: Distance = Field(0.0, description="metres at most, along each axis")
    angle_deg: Annotated[Degrees, Field(ge=0)] = Field(
        0.0, description="degrees at most, about each axis"
    )

    def errors(self) -> MountingErrors:
        """In the terms of `lidarplace`."""
        return MountingErrors(self.offset, math.radians(self.angle_deg))


class MountingErrorSettings(OffsetSettings):
    """How far mounts are off in simulated clouds: each frame has another vehicle of a fleet."""

    vehicle: Count | None = Field(
        None,
        description="test frames are all of this vehicle of the fleet; trainings do not depend on "
        "it",
    )

    @model_validator(mode="after")
    def _differ(self) -> MountingErrorSettings:
        if self.vehicle is not None and not self.errors():
            raise ValueError("vehicle: has no effect without offset or angle_deg")
        return self

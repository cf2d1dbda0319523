"""The pose of a sensor in a configuration."""

from __future__ import annotations

import math

from pydantic import Field, model_validator

from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import Angle, Aside, Degrees, Height, Name, Settings


class PoseSettings(Settings):
    """Pose of one sensor, metres and radians or degrees, in the convention of its placement."""

    name: Name | None = Field(None, description="name of the sensor, for other tools")
    x: Aside = Field(0.0, description="forward, metres")
    y: Aside = Field(0.0, description="to the left, metres")
    z: Height = Field(description="above the ground, metres")
    roll: Angle = Field(0.0, description="radians; > 0 lifts the left side")
    pitch: Angle = Field(0.0, description="radians; > 0 tips the nose down")
    yaw: Angle = Field(0.0, description="radians; > 0 turns to the left")
    roll_deg: Degrees | None = Field(None, description="degrees, in place of roll")
    pitch_deg: Degrees | None = Field(None, description="degrees, in place of pitch")
    yaw_deg: Degrees | None = Field(None, description="degrees, in place of yaw")

    @model_validator(mode="after")
    def _one_unit(self) -> PoseSettings:
        for name in ("roll", "pitch", "yaw"):
            if getattr(self, name) != 0 and getattr(self, f"{name}_deg") is not None:
                raise InputError(f"{name} is set, too", key=f"{name}_deg", fix="set only one")
        return self

    @property
    def pose(self) -> tuple[float, float, float, float, float, float]:
        """x, y, z in metres; roll, pitch, yaw in radians."""
        units = ((self.roll, self.roll_deg), (self.pitch, self.pitch_deg), (self.yaw, self.yaw_deg))
        roll, pitch, yaw = (rad if deg is None else math.radians(deg) for rad, deg in units)
        return self.x, self.y, self.z, roll, pitch, yaw

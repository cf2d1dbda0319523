"""Fog and rain in a configuration."""

import math
from typing import Annotated

from pydantic import Field, Strict

from lidarplace.configuration.settings import Settings
from lidarplace.rigs.weather import Weather

Visibility = Annotated[float, Strict(), Field(gt=0, le=1e9, allow_inf_nan=False)]
RainRate = Annotated[float, Strict(), Field(ge=0, le=1000, allow_inf_nan=False)]


class WeatherSettings(Settings):
    """Fog, rain, or both."""

    visibility: Visibility | None = Field(
        None, description="visibility in fog or haze, metres, at 2 % of contrast; null: clear air"
    )
    rain: RainRate = Field(0.0, description="millimetres per hour")

    def weather(self) -> Weather:
        """Build the weather."""
        return Weather(self.visibility or math.inf, self.rain)

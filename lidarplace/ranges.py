"""Ranges of the numbers that people give, one place per kind, for options and functions alike.

What is beyond is a mistake of a keyboard or of a unit, and would end for want of memory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`, both included, metres and seconds where they have a unit."""

    low: float
    high: float

    def check(self, what: str, value: float) -> None:
        """Raise ValueError that says `what` the value is, unless it is in the range; NaN is not."""
        if not self.low <= value <= self.high:
            raise ValueError(f"{what} must be within {self._text}, found {value}")

    @property
    def option(self) -> dict[str, Any]:
        """For an option of a command: `typer.Option(**FRAMES.option)`."""
        return {"min": self.low, "max": self.high, "callback": _not_nan}

    @property
    def _text(self) -> str:
        return f"{self.low:,} and {self.high:,}"


def _not_nan(value: Any) -> Any:
    """The value of an option; typer's own limits let NaN pass. Raises typer.BadParameter."""
    import typer

    for number in value if isinstance(value, list | tuple) else (value,):
        if isinstance(number, float) and math.isnan(number):
            raise typer.BadParameter("nan is no number.")
    return value


FRAMES = Range(1, 10_000_000)
"""How many frames there are."""
AZIMUTH_STEPS = Range(1, 1_000_000)
"""Rays of a beam in one turn; those of real LiDARs are thousands."""
RESOLUTION = Range(0.001, 100.0)
"""Edge of a voxel, metres."""
SHARE = Range(0.0, 1.0)
"""A share of something."""
LIDAR_HEIGHT = Range(0.0, 100.0)
"""Of a LiDAR above the ground, metres."""
SEED = Range(0, 2**32 - 1)
"""Of random numbers: what NumPy, torch and Optuna all take."""
PORT = Range(1, 65535)
"""Of a server."""
TIMEOUT = Range(0.001, 10_000_000.0)
"""Of a wait, seconds."""

"""Moments at which a LiDAR fires its rays within a frame."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError

STILL_WORLD = (
    "rate_hz changes simulated clouds alone: coverage, surrogates, requirements and the studio "
    "see a world that stands still at the moment of each frame."
)
"""Warning about LiDARs that take time for a frame."""


@dataclass(frozen=True)
class ScanTiming:
    """Timing of a LiDAR that takes `1 / rate` for a frame, half of it before the frame's moment.

    All beams fire together at an azimuth. A field of view below a full turn takes the whole time,
    as a mirror scans it; rays of a pattern are evenly spread in time.

    Attributes:
        rate: frames per second, Hz.
        phase: azimuth to which a full turn points at the frame's moment, radians; of others a full
            turn is a whole frame, and 0 the middle of the scan. None: free, drawn in every frame.
        direction: left, as azimuths grow and seen from above anticlockwise, or right.
        compensated: whether points are where the vehicle of the frame's moment would see them;
            else they are in the frame of the vehicle at the moment of each ray.

    Raises ValueError: the rate is not above 0, or the phase is not finite."""

    rate: float
    phase: float | None = 0.0
    direction: Literal["left", "right"] = "left"
    compensated: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.rate < math.inf:
            raise InputError(key="rate", expected="more than 0 Hz", found=self.rate)
        if self.phase is not None and not math.isfinite(self.phase):
            raise InputError(key="phase", expected="a finite angle", found=self.phase)

    @property
    def half(self) -> float:
        """Half of the time that a frame takes, seconds."""
        return 0.5 / self.rate

    def moments(self, shares: NDArray[np.float64], phase: float) -> NDArray[np.float64]:
        """Return moments of rays, seconds after that of the frame, within half a frame.

        `shares` of the scan at which they are fired, from -0.5 to 0.5; `phase` as drawn, radians.
        """
        sign = 1.0 if self.direction == "left" else -1.0
        turns = sign * (shares - phase / (2 * math.pi)) + 0.5
        return np.asarray((turns - np.floor(turns) - 0.5) / self.rate)

"""Ranges of the numbers that people give; beyond is a typing error or another unit."""

from dataclasses import dataclass
from numbers import Integral

from lidarplace.base.errors import InputError


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`, both included, metres and seconds where they have a unit."""

    low: float
    high: float

    def check(self, key: str, value: float, **parts: str) -> None:
        """Raise InputError, with other `parts`, unless the value of `key` is in the range.

        NaN is not."""
        if not self.low <= value <= self.high:
            allowed = f"{self.low:,} to {self.high:,}"
            raise InputError(key=key, expected=allowed, found=value, **parts)

    def check_whole(self, key: str, value: int) -> None:
        """Check a range of integers; see `check`."""
        if not isinstance(value, Integral):
            raise InputError(key=key, expected="a whole number", found=repr(value))
        self.check(key, value)


FRAME = Range(1 - 2**53, 2**53 - 1)
"""Number of a frame: whole also as a float, and others can follow it."""
FRAMES = Range(1, 10_000_000)
"""Number of frames."""
AZIMUTH_STEPS = Range(1, 1_000_000)
"""Rays of a beam in one turn; those of real LiDARs are thousands."""
RESOLUTION = Range(0.02, 100.0)
"""Edge of a voxel, metres."""
SHARE = Range(0.0, 1.0)
"""Share of something."""
ANGLE = Range(-6.2832, 6.2832)
"""Angle of a LiDAR on its mount, radians, a turn to either side: degrees are mostly beyond."""
LIDAR_HEIGHT = Range(0.0, 100.0)
"""Height of a LiDAR above the ground, metres."""
SEED = Range(0, 2**32 - 1)
"""Seed of random numbers that NumPy, torch and Optuna all take."""
PORT = Range(1, 65535)
"""Port of a server."""
TIMEOUT = Range(0.001, 10_000_000.0)
"""Time to wait, seconds."""

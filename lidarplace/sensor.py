"""A LiDAR model: its beam table, its azimuth steps and what limits and disturbs its returns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Lidar:
    """A spinning LiDAR that fires every beam at every azimuth step of a full turn.

    Attributes:
        elevations: elevation of every beam above the sensor's xy plane, radians, in [-pi/2, pi/2].
        azimuth_steps: firings of each beam in one turn.
        range: farthest return, metres.
        range_noise: standard deviation of the measured range, metres.
        drop_off: probability that a return is lost, in [0, 1).
    """

    elevations: tuple[float, ...]
    azimuth_steps: int
    range: float = 100.0
    range_noise: float = 0.0
    drop_off: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "elevations", tuple(float(e) for e in self.elevations))
        if not self.elevations:
            raise ValueError("a LiDAR needs at least one beam")
        if not all(abs(e) <= math.pi / 2 for e in self.elevations):
            raise ValueError(
                f"elevations must lie within [-pi/2, pi/2] radians, found {self.elevations}"
            )
        if self.azimuth_steps < 1:
            raise ValueError(f"azimuth_steps must be at least 1, found {self.azimuth_steps}")
        if not self.range > 0:
            raise ValueError(f"range must be positive, found {self.range}")
        if not (self.range_noise >= 0 and 0 <= self.drop_off < 1):
            raise ValueError(
                "range_noise must be >= 0 and drop_off within [0, 1), "
                f"found {self.range_noise} and {self.drop_off}"
            )

    @classmethod
    def paper(cls) -> Lidar:
        """The paper's sensor: 16 beams from -25 to 5 degrees, 90,000 points a frame at 20 Hz."""
        return cls(tuple(np.radians(np.linspace(-25.0, 5.0, 16))), azimuth_steps=5625)

    @property
    def beams(self) -> int:
        """Number of beams."""
        return len(self.elevations)

    def directions(self) -> NDArray[np.float64]:
        """Unit vectors of all rays in the sensor's frame, shape (beams * azimuth_steps, 3).

        Rays of one beam are contiguous; azimuth 0 is the sensor's x axis and grows towards y.
        """
        azimuth = np.arange(self.azimuth_steps) * (2 * math.pi / self.azimuth_steps)
        elevation = np.asarray(self.elevations)[:, None]
        horizontal = np.cos(elevation)
        rays = np.stack(
            [
                horizontal * np.cos(azimuth),
                horizontal * np.sin(azimuth),
                np.broadcast_to(np.sin(elevation), (self.beams, self.azimuth_steps)),
            ],
            axis=-1,
        )
        return rays.reshape(-1, 3)

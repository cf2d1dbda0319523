"""The region of interest and its voxels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Interval = tuple[float, float]

MOST_CELLS = 10**9
"""Voxels along one axis."""


@dataclass(frozen=True)
class Roi:
    """A box in the ego frame, divided into cubic voxels.

    Voxel (i, j, k) spans `[min + i * resolution, min + (i + 1) * resolution)` on each axis.

    Attributes:
        x, y, z: (min, max) in metres.
        resolution: edge of a voxel in metres.

    Raises:
        ValueError: an interval is empty or not finite, or no multiple of the resolution.
    """

    x: Interval
    y: Interval
    z: Interval
    resolution: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resolution) and self.resolution > 0):
            raise ValueError(f"resolution must be a positive length, found {self.resolution}")
        for axis in "xyz":
            low, high = (float(value) for value in getattr(self, axis))
            object.__setattr__(self, axis, (low, high))
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError(f"ROI {axis} needs min < max, found [{low}, {high}]")
            cells = (high - low) / self.resolution
            if not cells <= MOST_CELLS:
                raise ValueError(
                    f"ROI {axis} is {high - low:g} m long, {cells:g} voxels of {self.resolution:g} "
                    f"m; allowed are {MOST_CELLS:,}"
                )
            if round(cells) < 1 or abs(cells - round(cells)) > 1e-6 * max(1.0, cells):
                whole = max(1, round(cells))
                raise ValueError(
                    f"ROI {axis} is {high - low:g} m long, no multiple of the resolution "
                    f"{self.resolution:g} m; the nearest multiple is "
                    f"{whole * self.resolution:.10g} m, "
                    f"the nearest resolution that fits is {(high - low) / whole:.10g} m"
                )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels along x, y and z."""
        nx, ny, nz = (
            round((high - low) / self.resolution) for low, high in (self.x, self.y, self.z)
        )
        return nx, ny, nz

    @property
    def minimum(self) -> NDArray[np.float64]:
        """The corner of smallest coordinates, shape (3,), metres."""
        return np.array([self.x[0], self.y[0], self.z[0]])

    def centres(self, axis: int) -> NDArray[np.float64]:
        """Coordinates of the voxel centres along `axis` (0, 1, 2), metres."""
        return self.minimum[axis] + (np.arange(self.shape[axis]) + 0.5) * self.resolution

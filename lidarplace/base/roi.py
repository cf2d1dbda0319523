"""The region of interest and its voxels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError

Interval = tuple[float, float]

MOST_CELLS = 10**9
"""Voxels along one axis."""


def _interval(axis: str, found: Any) -> Interval:
    """Two numbers. Raises ValueError that says so."""
    try:
        low, high = (float(value) for value in found if not isinstance(value, str))
    except (TypeError, ValueError):
        raise InputError(f"ROI {axis} is (min, max) in metres", found=repr(found)) from None
    return low, high


@dataclass(frozen=True)
class Roi:
    """A box in the ego frame, divided into cubic voxels.

    Voxel (i, j, k) spans `[min + i * resolution, min + (i + 1) * resolution)` on each axis.

    Attributes:
        x, y, z: (min, max) in metres.
        resolution: edge of a voxel in metres.

    Raises:
        ValueError: an interval is no pair of numbers, empty, not finite, or no multiple of the
            resolution.
    """

    x: Interval
    y: Interval
    z: Interval
    resolution: float

    def __post_init__(self) -> None:
        if not isinstance(self.resolution, int | float | np.number):
            raise InputError("resolution is a length in metres", found=repr(self.resolution))
        if not (math.isfinite(self.resolution) and self.resolution > 0):
            raise InputError("resolution must be a positive length", found=self.resolution)
        for axis in "xyz":
            low, high = _interval(axis, getattr(self, axis))
            object.__setattr__(self, axis, (low, high))
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise InputError(f"ROI {axis} needs min < max", found=f"[{low}, {high}]")
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
        low, steps = self.minimum[axis], np.arange(self.shape[axis]) + 0.5
        return np.asarray(low + steps * self.resolution)

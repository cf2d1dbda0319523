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
"""Largest number of voxels along one axis."""


def _interval(key: str, ends: Any) -> Interval:
    """Return two numbers. Raises InputError for anything else."""
    try:
        low, high = (float(value) for value in ends if not isinstance(value, str))
    except (TypeError, ValueError):
        raise InputError(key=key, expected="(min, max) in metres", found=repr(ends)) from None
    return low, high


def _cells(low: float, high: float, edge: float) -> int:
    """Return the whole number of edges, at least 1, that is nearest to an interval."""
    return max(1, round((high - low) / edge))


def _resized(low: float, high: float, length: float) -> Interval:
    """Return an interval of this length: symmetric about 0, or with the same lower end."""
    start = -0.5 * length if low == -high else low
    return round(start, 9), round(start + length, 9)


@dataclass(frozen=True)
class Roi:
    """A box in the ego frame, divided into cubic voxels.

    Voxel (i, j, k) spans `[min + i * resolution, min + (i + 1) * resolution)` on each axis.

    Attributes:
        x, y, z: (min, max) in metres.
        resolution: edge of a voxel in metres.

    Raises:
        ValueError: an interval is not a pair of numbers, is empty, not finite, or not a multiple
            of the resolution."""

    x: Interval
    y: Interval
    z: Interval
    resolution: float

    def __post_init__(self) -> None:
        edge = self.resolution
        if not isinstance(edge, int | float | np.number) or not (math.isfinite(edge) and edge > 0):
            raise InputError(key="resolution", expected="a length > 0 in metres", found=repr(edge))
        for axis in "xyz":
            low, high = _interval(key := f"roi.{axis}", getattr(self, axis))
            object.__setattr__(self, axis, (low, high))
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise InputError(key=key, expected="min < max", found=f"[{low}, {high}]")
            cells = (high - low) / edge
            problem = f"{high - low:g} m at a resolution of {edge:g} m"
            if not cells <= MOST_CELLS:
                most = f"at most {MOST_CELLS:,} voxels"
                raise InputError(problem, key=key, expected=most, found=f"{cells:g}")
            if round(cells) < 1 or abs(cells - round(cells)) > 1e-6 * max(1.0, cells):
                whole = _cells(low, high, edge)
                near_low, near_high = _resized(low, high, whole * edge)
                fix = f"the nearest is [{near_low:g}, {near_high:g}], "
                fix += f"the nearest resolution {(high - low) / whole:.10g} m"
                raise InputError(problem, key=key, expected="a whole number of voxels", fix=fix)

    @classmethod
    def nearest(cls, x: Interval, y: Interval, z: Interval, resolution: float) -> Roi:
        """Return the ROI of whole voxels that is nearest to these sides. Raises as `Roi`."""
        x, y, z = (_resized(*s, _cells(*s, resolution) * resolution) for s in (x, y, z))
        return cls(x, y, z, resolution)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels along x, y and z."""
        nx, ny, nz = (
            round((high - low) / self.resolution) for low, high in (self.x, self.y, self.z)
        )
        return nx, ny, nz

    @property
    def minimum(self) -> NDArray[np.float64]:
        """Corner of smallest coordinates, shape (3,), metres."""
        return np.array([self.x[0], self.y[0], self.z[0]])

    def centres(self, axis: int) -> NDArray[np.float64]:
        """Return coordinates of the voxel centres along `axis` (0, 1, 2), metres."""
        low, steps = self.minimum[axis], np.arange(self.shape[axis]) + 0.5
        return np.asarray(low + steps * self.resolution)

"""Correction of a LiDAR: returns that its ray model has and a real vehicle loses."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError

OTHER = "other"  # class of a factor for objects of all classes without one of their own

MOST_FACTOR = 10.0  # beyond, the recording and its simulation are not of one rig
LEAST_DISTANCE = 1e-300  # metres; its inverse is a number
_HAIR = 1e-9  # of a bin: a ray on an edge belongs to the upper bin, whatever rounding makes of it


@dataclass(frozen=True)
class Mask:
    """Share of rays that return by direction in the sensor's frame: the vehicle's own shadow."""

    shares: tuple[tuple[float, ...], ...]
    """Rows by elevation from the lowest, each of equal bins of azimuth over a full turn, the first
    of which begins at -pi; in [0, 1], not all 0."""
    edges: tuple[float, ...] = ()  # elevations between the rows, ascending, radians
    turn: float = 0.0  # of the frame of directions in that of the bins, radians to the left

    def __post_init__(self) -> None:
        rows = tuple(tuple(map(float, row)) for row in self.shares)
        object.__setattr__(self, "shares", rows)
        object.__setattr__(self, "edges", tuple(map(float, self.edges)))
        if len(rows) != len(self.edges) + 1:
            needed = f"{len(self.edges) + 1} rows for {len(self.edges)} elevations between them"
            raise InputError(key="shares", expected=needed, found=len(rows))
        if len(lengths := sorted({len(row) for row in rows})) > 1 or not rows[0]:
            needed = "rows with equally many, at least one"
            raise InputError(key="shares", expected=needed, found=lengths)
        if any(not low < high for low, high in pairwise(self.edges)):
            raise ValueError("elevations between rows must rise")
        if not all(0 <= share <= 1 for row in rows for share in row):
            raise InputError(key="shares", expected="numbers within [0, 1]")
        if not any(map(any, rows)):
            raise InputError("all shares are 0", key="shares", fix="leave the LiDAR out")

    def at(
        self, azimuths: NDArray[np.float64], elevations: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return shares in these directions, radians; the arguments are broadcast."""
        table = np.array(self.shares)
        turns = (azimuths + self.turn + math.pi) / (2 * math.pi) % 1.0
        columns = np.floor(turns * table.shape[1] + _HAIR).astype(np.int64) % table.shape[1]
        rows = np.searchsorted(np.array(self.edges), elevations, side="right")
        return np.asarray(table[rows, columns])


@dataclass(frozen=True)
class Correction:
    """The probability that a ray returns from what it hits.

    It is `factor * exp(-range / distance) * mask`, at most 1, for a ray on an object and `mask` for
    all other hits. `Lidar.drop_off` is lost besides."""

    factor: tuple[tuple[str, float], ...] = ()
    """Pairs of a class of objects and its factor, in [0, MOST_FACTOR]; class OTHER stands for those
    without one, whose factor is 1 otherwise."""
    distance: float | None = None  # metres after which 1/e of the rays return from objects
    mask: Mask | None = None  # None: 1 in all directions

    def __post_init__(self) -> None:
        pairs = tuple(sorted((str(name), float(share)) for name, share in self.factor))
        object.__setattr__(self, "factor", pairs)
        for name, share in pairs:
            if not 0 <= share <= MOST_FACTOR:
                allowed = f"a number within [0, {MOST_FACTOR:g}]"
                raise InputError(key=f"factor.{name}", expected=allowed, found=share)
        if len(dict(pairs)) < len(pairs):
            raise InputError("duplicate class", key="factor")
        if self.distance is not None and not LEAST_DISTANCE <= self.distance < math.inf:
            allowed = f"a finite number, at least {LEAST_DISTANCE:g} m"
            raise InputError(key="distance", expected=allowed, found=self.distance)

    def __repr__(self) -> str:
        parts = [f"{name} {share:.3g}" for name, share in self.factor]
        parts += [] if self.distance is None else [f"distance {self.distance:.4g} m"]
        parts += [] if self.mask is None else [f"mask of {np.size(self.mask.shares)} directions"]
        return f"Correction({', '.join(parts)})"

    @property
    def loss(self) -> float:
        """Inverse of `distance`, 1/m; 0 without one."""
        return 0.0 if self.distance is None else 1.0 / self.distance

    def factors_of(self, classes: Iterable[str]) -> NDArray[np.float64]:
        """Return factors of objects of these classes, shape (objects,)."""
        factors = dict(self.factor)
        rest = factors.get(OTHER, 1.0)
        return np.array([factors.get(name, rest) for name in classes], np.float64)

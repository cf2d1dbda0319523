"""Inputs of surrogates: the sight that a placement has of a class."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarplace.coverage import Method
from lidarplace.pog.surrogates.formulas import Crossings


@dataclass(frozen=True)
class Sensing:
    """Settings of coverage and of rays; see `lidarplace.evaluate`."""

    method: Method = "cone"
    detection_probability: float = 0.1
    occlusion: bool = False
    azimuth_stride: int = 1


@dataclass(frozen=True, eq=False)
class SurrogateInputs:
    """Inputs of the surrogates of one class, for a placement on its POG.

    Those that need rays are computed when they are called.

    Voxels that are occupied in equally many frames are one level.

    Attributes:
        frames: of the POG, T.
        counts: in how many of them a voxel of each level is occupied, int, shape (levels,).
        voxels, covered: number of voxels of each level, and how many are covered, shape (levels,).
        entropy: H of a voxel of each level, nats, shape (levels,).
        h_pog: entropy of the POG, nats.
        crossings: counts and rays of the occupied voxels that are crossed.
        points: `sum of m(v) p(v)`, see `lidarplace.pog.surrogates.formulas.expected_points`.
        information: nats, see `lidarplace.pog.surrogates.formulas.expected_ig`."""

    frames: int
    counts: NDArray[np.integer]
    voxels: NDArray[np.number]
    covered: NDArray[np.number]
    entropy: NDArray[np.float64]
    h_pog: float
    crossings: Callable[[], Crossings]
    points: Callable[[], float]
    information: Callable[[], float]

    def entropy_of(self, number: NDArray[np.number]) -> float:
        """Return the sum of H over `number[n]` voxels of level n, nats.

        It is of few exact terms, right to its last bits."""
        return math.fsum(number * self.entropy)

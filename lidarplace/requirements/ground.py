"""What every place on the ground around a vehicle has of what is required there, for a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # who draws needs no rays
    from lidarplace.requirements.judge import Outcome

MOST_CELLS = 160
"""Along an axis; of more positions a cell shows the worst one."""


@dataclass(frozen=True, eq=False)
class Ground:
    """A grid of cells.

    Attributes:
        x, y: middles of the cells, metres, shapes (nx,) and (ny,).
        least: of all cases and of all positions in a cell, in the requirement's measure; NaN where
            nothing is asked; shape (nx, ny).
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    least: NDArray[np.float64]

    @classmethod
    def of(cls, outcome: Outcome) -> Ground:
        """That of a requirement under one rig."""
        positions = outcome.positions
        least = np.full(positions.held.shape, np.nan)
        least[positions.held] = np.where(np.isfinite(outcome.least_of), outcome.least_of, np.nan)
        middles = []
        for axis, line in enumerate((positions.x, positions.y)):
            step = -(-len(line) // MOST_CELLS)
            starts = np.arange(0, len(line), step)
            least = np.fmin.reduceat(least, starts, axis=axis)
            middles.append(np.add.reduceat(line, starts) / np.diff(np.append(starts, len(line))))
        return cls(middles[0], middles[1], least)

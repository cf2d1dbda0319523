"""Parts of an area: a rectangle around each position, split where a verdict is near its limit."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from lidarplace.requirements.area import Positions

FINEST_M = 0.05
"""Edge of parts that are not split further, metres."""
_TURNS = np.array([[0.7548776662466927, 0.5698402909980532], [0.5698402909980532, 0.3247179572]])
MOST_SPLITS = 4
"""Number of times that the rectangle around a position is split: steps to 0.8 m reach FINEST_M."""


class Parts(NamedTuple):
    """Rectangles of an area, with a place in each that stands for it."""

    corners: NDArray[np.int64]  # numbers of the first finest cell along x and y, shape (N, 2)
    points: NDArray[np.float64]  # places in the area, metres, shape (N, 2)
    weights: NDArray[np.float64]  # finest cells of the area in each part, shape (N,)
    positions: NDArray[np.intp]  # number of the position that the part is around, shape (N,)
    sampled: NDArray[np.bool_]  # whether the place is anywhere in the part, shape (N,)

    def select(self, rows: NDArray[np.bool_]) -> Parts:
        """Select some of the parts."""
        points, weights = self.points[rows], self.weights[rows]
        positions, sampled = self.positions[rows], self.sampled[rows]
        return Parts(self.corners[rows], points, weights, positions, sampled)


@dataclass(frozen=True, eq=False)
class FinestCells:
    """The finest cells of an area, `per_edge` along each side of the rectangle of a position.

    Attributes:
        low: corner of the first cell, metres, shape (2,).
        edges: lengths of a cell along x and y, metres, shape (2,).
        per_edge: a power of two.
        inside: whether an object may stand in the middle of each cell."""

    low: NDArray[np.float64]
    edges: NDArray[np.float64]
    per_edge: int
    inside: NDArray[np.bool_]

    @property
    def levels(self) -> int:
        """Number of times that a part can be split."""
        return self.per_edge.bit_length() - 1

    def half(self, level: int) -> NDArray[np.float64]:
        """Return half the edges of a part that was split `level` times, metres, shape (2,)."""
        return 0.5 * self.span(level) * self.edges

    def span(self, level: int) -> int:
        """Return the finest cells along an edge of a part that was split `level` times."""
        return self.per_edge >> level

    def parts(self, corners: NDArray[np.int64], positions: NDArray[np.intp], span: int) -> Parts:
        """Return the parts of `span` cells along each edge that begin at `corners`.

        The place of a part is in the cell inside that is nearest to its middle, and of equal ones
        the one nearest to y = 0: so it is symmetric where the area is."""
        steps = np.arange(span)
        rows, columns = (corners[:, axis, None] + steps for axis in range(2))
        blocks = self.inside[rows[:, :, None], columns[:, None]].reshape(len(corners), -1)
        off = (2 * steps - span + 1) ** 2
        aside = np.abs(self.low[1] + (columns + 0.5) * self.edges[1])
        away = (off[:, None] + off + 1e-6 * aside[:, None]).reshape(len(corners), -1)
        nearest = np.where(blocks, away, np.inf).argmin(axis=1)
        within = np.stack([nearest // span, nearest % span], axis=1) + 0.5
        points = self.low + (corners + within) * self.edges
        weights = blocks.sum(axis=1).astype(np.float64)
        return Parts(corners, points, weights, positions, np.zeros(len(corners), np.bool_))

    def split(self, parts: Parts, level: int) -> Parts:
        """Return the quarters of parts, those of `level`, that have something inside.

        Places in whole quarters are those of a sequence of low discrepancy (R2 by M. Roberts), by
        which no limit along an axis has all places on one side."""
        span = self.span(level)
        shifts = span * np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
        corners = (parts.corners[:, None] + shifts).reshape(-1, 2)
        quarters = self.parts(corners, np.repeat(parts.positions, 4), span)
        whole, shares = quarters.weights == span**2, (corners @ _TURNS) % 1.0
        places = self.low + (corners + span * shares) * self.edges
        points = np.where(whole[:, None], places, quarters.points)
        quarters = quarters._replace(points=points, sampled=np.ones_like(whole))
        return quarters.select(quarters.weights > 0)


def parts_around(
    grid: Positions, step: float, holds: Callable[[NDArray[np.float64]], NDArray[np.bool_]]
) -> tuple[NDArray[np.bool_], FinestCells, Parts]:
    """Return the positions of an area, its finest cells, and the part around each position.

    A point next to those of `grid` is a position, too, if a part of the area is around it. Returns
    which points of the grid are positions, shape (nx, ny). `holds`: whether places (N, 2) belong to
    the area, asked for at its sides."""
    per_edge = 2 ** min(max(0, math.ceil(math.log2(step / FINEST_M) - 1e-9)), MOST_SPLITS)
    lines, block = (grid.x, grid.y), np.ones((per_edge, per_edge), np.bool_)
    steps = np.array([(line[-1] - line[0]) / max(1, len(line) - 1) for line in lines])
    whole = minimum_filter(grid.held, 3, mode="constant", cval=0)
    near = maximum_filter(grid.held, 3, mode="constant", cval=0)
    inside = np.kron(whole, block)
    low, edges = np.array([grid.x[0], grid.y[0]]) - 0.5 * steps, steps / per_edge
    cells = np.argwhere(np.kron(near & ~whole, block))
    inside[cells[:, 0], cells[:, 1]] = holds(low + (cells + 0.5) * edges)
    finest = FinestCells(low, edges, per_edge, inside)
    corners = np.argwhere(near) * per_edge
    parts = finest.parts(corners, np.arange(len(corners)), per_edge)
    on_grid = grid.held[near]
    parts.points[on_grid] = grid.points
    held = near.copy()
    held[near] = on_grid | (parts.weights > 0)
    parts = parts.select(held[near])
    return held, finest, parts._replace(positions=np.arange(len(parts.weights)))

"""Edges of lanes, to be drawn from above."""

import numpy as np
from numpy.typing import NDArray

_HAIR_M = 0.02
"""How far inside of another lane an edge is hidden, metres: lanes side by side only touch."""
_CORNERS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def lane_edges(lanes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the edges of the ground that lanes cover, and those between lanes side by side.

    `lanes`: x, y, yaw, half of the length, half of the width, metres, shape (m, 5). A row of NaN
    is behind each edge, shape (n, 2)."""
    c, s = np.cos(lanes[:, 2]), np.sin(lanes[:, 2])
    turn = np.stack([c, -s, s, c], axis=1).reshape(-1, 2, 2)
    corners = np.einsum("mij,mkj->mki", turn, _CORNERS * lanes[:, None, 3:]) + lanes[:, None, :2]
    starts = corners.reshape(-1, 2)
    steps = np.roll(corners, -1, axis=1).reshape(-1, 2) - starts
    lines = [np.empty((0, 2))]
    for start, step, *hidden in zip(
        starts, steps, *_hidden(starts, steps, lanes, turn), strict=True
    ):
        for first, last in _visible(*hidden):
            lines += [start + [[first], [last]] * step, np.full((1, 2), np.nan)]
    return np.concatenate(lines).astype(np.float32)


def _hidden(
    starts: NDArray[np.float64],
    steps: NDArray[np.float64],
    lanes: NDArray[np.float64],
    turn: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return where each edge enters and leaves each lane, as shares of it, shape (2, edges, m)."""
    local = np.einsum("emi,mij->emj", starts[:, None] - lanes[:, :2], turn)
    along = np.einsum("ei,mij->emj", steps, turn)
    along = np.where(np.abs(along) < 1e-9, 1e-9, along)
    half = lanes[:, 3:] - _HAIR_M
    ends = np.sort(np.stack([(-half - local) / along, (half - local) / along]), axis=0)
    return np.stack([ends[0].max(axis=2), ends[1].min(axis=2)])


def _visible(enter: NDArray[np.float64], leave: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Return the parts of an edge, from 0 to 1, that no interval holds."""
    place, parts = 0.0, []
    for first, last in sorted(zip(enter.clip(0, 1), leave.clip(0, 1), strict=True)):
        if last > first:
            parts += [(place, first)] if first > place else []
            place = max(place, last)
    return parts + ([(place, 1.0)] if place < 1.0 else [])

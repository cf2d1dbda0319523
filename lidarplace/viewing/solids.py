"""Boxes as lines and as triangles, in the layout that plotly reads."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.logs.boxes import corners

# A line that runs along all twelve edges; -1 lifts the pen.
_EDGES = np.array([0, 1, 3, 2, 0, 4, 5, 7, 6, 4, -1, 1, 5, -1, 3, 7, -1, 2, 6, -1])
_TRIANGLES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5],
    ]
)  # fmt: skip


def edges(boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the edges of boxes (m, 7) as one line, broken by NaN; shape (n, 3), metres."""
    points = np.full((len(boxes), 9, 3), np.nan)  # the ninth is picked by -1
    points[:, :8] = corners(boxes)
    return points[:, _EDGES].reshape(-1, 3).astype(np.float32)


def headings(boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Draw a line on the roof of each of boxes (m, 7), from its middle to its front edge, then NaN.

    Shape (m, 3, 3), metres."""
    roof = corners(boxes)[:, 4:]
    front = roof[:, [1, 3]].mean(axis=1)
    return np.stack([roof.mean(axis=1), front, np.full_like(front, np.nan)], 1).astype(np.float32)


def triangles(boxes: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return the faces of boxes (m, 7): vertices (8 m, 3) in metres, and triangles (12 m, 3)."""
    first = 8 * np.arange(len(boxes))[:, None, None]
    faces = (first + _TRIANGLES).reshape(-1, 3).astype(np.int32)
    return corners(boxes).reshape(-1, 3).astype(np.float32), faces

"""Outlines of vehicles from above or from a side, to be drawn."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.mounting.vehicle import Vehicle

_STEPS = 200
"""Number of places along the first axis at which the ends of a mesh are computed."""


def outline(vehicle: Vehicle, axes: tuple[int, int] = (0, 1)) -> NDArray[np.float64]:
    """Return `closed_lines` as one, a row of NaN behind each of them, shape (n, 2)."""
    gap = np.full((1, 2), np.nan)
    lines = closed_lines(vehicle, axes)
    return np.concatenate([np.empty((0, 2)), *(part for line in lines for part in (line, gap))])


def closed_lines(vehicle: Vehicle, axes: tuple[int, int]) -> list[NDArray[np.float64]]:
    """Return a line around each box and one around the mesh, metres, shapes (n, 2).

    `axes` are those in view: 0 and 1 from above, 0 and 2 from the side. The line around the mesh
    leads along its ends in the second axis: what is between them counts as filled."""
    lines = [
        np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
        for (x0, y0), (x1, y1) in vehicle.boxes[:, :, axes].tolist()
    ]
    for pose in vehicle.poses.values():
        if pose.mesh is not None:
            lines.append(_around(pose.mesh.triangles[:, :, axes]))
    return lines


def _around(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a closed line around triangles in a plane, shape (T, 3, 2)."""
    starts = triangles.reshape(-1, 2)
    ends = np.roll(triangles, -1, axis=1).reshape(-1, 2)
    low, high = np.minimum(starts[:, 0], ends[:, 0]), np.maximum(starts[:, 0], ends[:, 0])
    steep = low == high
    length = np.where(steep, 1.0, ends[:, 0] - starts[:, 0])
    places = np.linspace(low.min(), high.max(), _STEPS)
    least, most = np.empty(_STEPS), np.empty(_STEPS)
    for i, place in enumerate(places.tolist()):
        met = (low <= place) & (place <= high)
        share = (place - starts[met, 0]) / length[met]
        across = starts[met, 1] + share * (ends[met, 1] - starts[met, 1])
        across = np.where(steep[met], ends[met, 1], across)  # its start is the end of another one
        # Nothing is met between parts that are apart.
        least[i], most[i] = (across.min(), across.max()) if len(across) else (np.nan, np.nan)
    filled = ~np.isnan(least)
    low_side = np.stack([places, least], axis=1)[filled]
    high_side = np.stack([places, most], axis=1)[filled][::-1]
    return np.concatenate([low_side, high_side, low_side[:1]])

"""The vehicle as seen from above, to be drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from lidarplace.mounting.vehicle import Vehicle


def outline(vehicle: Vehicle) -> NDArray[np.float64]:
    """Closed lines around each box and around the mesh, x and y in metres, shape (n, 2).

    A row of NaN is behind each of them.
    """
    lines = [
        np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
        for (x0, y0, _), (x1, y1, _) in vehicle.boxes.tolist()
    ]
    if vehicle.mesh is not None:
        from_above = vehicle.mesh.vertices[:, :2]
        # What is a line from above has a hull, too, if its points are jiggled.
        hull = from_above[ConvexHull(from_above, qhull_options="QJ").vertices]
        lines.append(np.concatenate([hull, hull[:1]]))
    gap = np.full((1, 2), np.nan)
    return np.concatenate([np.empty((0, 2)), *(part for line in lines for part in (line, gap))])

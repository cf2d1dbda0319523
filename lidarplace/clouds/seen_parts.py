"""Parts as many LiDARs see them: windows and planes, for rays that are cast elsewhere.

Rays are cast at them as `lidarplace.clouds.raycast` explains; what it passes over is left out."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.clouds.convex import fill_corners, fill_planes, window_of
from lidarplace.clouds.hashed import stream_of
from lidarplace.clouds.raycast import is_apart

SEEN_COLUMNS = 37
"""Of `Views.fill_seen`: 6 planes of 5 numbers, the azimuth of the middle of the window and half its
width, its lowest and highest elevation, the number of planes that face the sensor, the owner, and
the reflectivity."""


class Views(NamedTuple):
    """LiDARs in frames, V of them; those with offset lasers are split into `blocks`.

    Attributes:
        origins, rotations: of the sensors in the ego frame, shapes (V, 3) and (V, 3, 3).
        reach: of the rays, metres, shape (V,).
        regions: where hits matter, `crop` of `cast`, shape (V, 6).
        elevations: lowest and highest of the beams, radians, shape (V, 2).
        keys: seed, frame and index of the LiDAR, shape (V, 3), uint64.
        parts: first and past the last of the parts in its frame, shape (V, 2), int64."""

    origins: NDArray[np.float64]
    rotations: NDArray[np.float64]
    reach: NDArray[np.float64]
    regions: NDArray[np.float64]
    elevations: NDArray[np.float64]
    keys: NDArray[np.uint64]
    parts: NDArray[np.int64]


@njit(cache=True, nogil=True, error_model="numpy")
def fill_seen(views, surfaces, seen, rows, streams):
    """Fill the rows of all parts that some ray of each view may meet; return their number.

    `surfaces` are the `Surfaces` of all frames, `seen` has at least as many rows as all views have
    parts, shape (n, SEEN_COLUMNS), `rows` becomes the first and past the last of every view, shape
    (V, 2), `streams` the stream of its random numbers, shape (V,), uint64."""
    corners, planes = np.empty((8, 3)), np.empty((6, 5))
    count = 0
    for view in range(len(views.reach)):
        origin, rotation = views.origins[view], views.rotations[view]
        streams[view], rows[view, 0] = stream_of(views.keys[view]), count
        for part in range(views.parts[view, 0], views.parts[view, 1]):
            fill_corners(surfaces.geometry[part], corners)
            if is_apart(corners, origin, views.regions[view]):
                continue
            window = window_of(corners, origin, rotation)
            between = window.lowest <= views.elevations[view, 1]
            between &= window.highest >= views.elevations[view, 0]
            if window.nearest > views.reach[view] or not between:
                continue
            facing = fill_planes(surfaces.geometry[part], origin, rotation, planes)
            if facing == 0:
                continue
            row = seen[count]
            for k in range(6):
                row[5 * k : 5 * k + 5] = planes[k]
            row[30] = window.azimuth + 0.5 * (window.left - window.right)
            row[31] = 0.5 * (window.left + window.right)
            row[32], row[33], row[34] = window.lowest, window.highest, facing
            row[35], row[36] = surfaces.owner[part], surfaces.reflectivity[part]
            count += 1
        rows[view, 1] = count
    return count

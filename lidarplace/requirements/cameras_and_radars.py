"""Measures of objects by cameras and radars: pixels, and range to spare."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.mounting.field_of_view import in_view, view_of_sensor
from lidarplace.mounting.housing import housings_in
from lidarplace.mounting.sight import Obstacles, obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.further_sensors import Camera, MountedSensor
from lidarplace.rigs.placement import Placement

POINTS = 5  # along each edge of an object: at these its surface is looked at


def measure_each(
    sensors: Sequence[MountedSensor],
    boxes: NDArray[np.float64],
    object_class: str | None,
    rig: Placement,
    vehicle: Vehicle,
) -> NDArray[np.float64]:
    """Measure each object by each sensor, shape (B, sensors).

    A camera has the pixels across or up, whichever are fewer, of what it sees of the object; a
    radar its range for objects of a class, or any, as a multiple of the distance to the nearest
    part that it sees, 0 beyond it. Housings of the LiDARs of `rig` hide what is behind them, and so
    does the vehicle, but for parts within which the sensor is. Boxes are rows of
    `lidarplace.logs.boxes.GEOMETRY`, shape (B, 7)."""
    measures = np.zeros((len(boxes), len(sensors)))
    for column, sensor in zip(measures.T, sensors, strict=True):
        reach = sensor.range_of(object_class)
        view = view_of_sensor(sensor, reach)
        obstacles = obstacles_of(vehicle, housings_in(rig), sensor.mount.position)
        seen = _seen(view, obstacles, boxes)
        if isinstance(sensor.model, Camera):
            column[:] = np.minimum(*(seen[:, :2] * sensor.model.focal).T)
        else:
            with np.errstate(divide="ignore"):
                column[:] = reach / seen[:, 2]
    return measures


@njit(cache=True, nogil=True, error_model="numpy")
def _seen(view, obstacles: Obstacles, boxes):
    """Return extents across and up of what is seen of each box, as slopes, and its distance."""
    extents = np.zeros((len(boxes), 3))
    o, r, last = view.origin, view.rotation, POINTS - 1
    for b in range(len(boxes)):
        box = boxes[b]
        c, s = math.cos(box[6]), math.sin(box[6])
        left, right, top, bottom, nearest = math.inf, -math.inf, -math.inf, math.inf, math.inf
        for i in range(POINTS):
            for j in range(POINTS):
                for k in range(POINTS):
                    if 0 < i < last and 0 < j < last and 0 < k < last:
                        continue
                    u, v = (i / last - 0.5) * box[3], (j / last - 0.5) * box[4]
                    dx = box[0] + c * u - s * v - o[0]
                    dy = box[1] + s * u + c * v - o[1]
                    dz = box[2] + (k / last - 0.5) * box[5] - o[2]
                    viewed = in_view(view, o[0] + dx, o[1] + dy, o[2] + dz)
                    if not viewed or stopped(o, dx, dy, dz, 1.0, obstacles, -1):
                        continue
                    nearest = min(nearest, math.sqrt(dx * dx + dy * dy + dz * dz))
                    ahead = r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz
                    across = (r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz) / ahead
                    up = (r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz) / ahead
                    left, right = min(left, across), max(right, across)
                    bottom, top = min(bottom, up), max(top, up)
        if nearest < math.inf:
            extents[b, 0], extents[b, 1] = right - left, top - bottom
        extents[b, 2] = nearest
    return extents

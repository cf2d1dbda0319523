"""Fields of view: a box of angles or a cone in the sensor's frame, or the pyramid of a camera."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit
from lidarplace.mounting.housing import turned
from lidarplace.rigs.further_sensors import Camera, MountedSensor
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

_HAIR = 1e-12  # ends of a field of view belong to it


class FieldOfView(NamedTuple):
    """Directions in the frame of a sensor, up to its reach; all of these limits hold.

    Attributes:
        azimuth: the first one and how far it goes on to the left, radians.
        sines: of the lowest and the highest elevation.
        cosine: of half the angle of a cone about the x axis; -1: none.
        slopes: of a pyramid about the x axis to the left, to the right, up and down, as parts of
            what is ahead; infinite: none.
        reach: metres."""

    azimuth: tuple[float, float]
    sines: tuple[float, float]
    cosine: float
    slopes: tuple[float, float, float, float]
    reach: float


NO_SLOPES = (math.inf, math.inf, math.inf, math.inf)


class View(NamedTuple):
    """A field of view on a vehicle: the place of its sensor, and the rotation from its frame."""

    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    field: FieldOfView


@lru_cache(maxsize=64)
def field_of(lidar: Lidar) -> FieldOfView:
    """Return the field of view of a LiDAR, from its lowest to its highest beam.

    That of a pattern is also the cone about all of its rays."""
    start, end = lidar.azimuth
    width = 2 * math.pi if lidar.full_turn else end - start
    cosine = -1.0 if lidar.pattern is None else float(lidar.directions()[:, 0].min())
    sines = math.sin(min(lidar.elevations)), math.sin(max(lidar.elevations))
    return FieldOfView((start, width), sines, cosine, NO_SLOPES, lidar.reach)


def pyramid(slopes: tuple[float, float, float, float], reach: float) -> FieldOfView:
    """Return the field of view of a camera with these slopes, see `FieldOfView.slopes`."""
    left, right, up, down = (math.atan(slope) for slope in slopes)
    return FieldOfView((-right, right + left), (-math.sin(down), math.sin(up)), -1.0, slopes, reach)


def view_of_sensor(sensor: MountedSensor, reach: float) -> View:
    """Return the view of a camera or a radar up to `reach`, metres."""
    model = sensor.model
    if isinstance(model, Camera):
        (width, height), (fx, fy), (cx, cy) = model.pixels, model.focal, model.centre
        slopes = (cx / fx, (width - cx) / fx, cy / fy, (height - cy) / fy)
        return view_of(sensor.mount, pyramid(slopes, reach))
    low, high = model.elevation
    sines = math.sin(low), math.sin(high)
    return view_of(sensor.mount, FieldOfView(model.azimuth, sines, -1.0, NO_SLOPES, reach))


def view_of(mount: Mount, field: FieldOfView) -> View:
    """Return the view of a sensor on this mount."""
    return View(mount.position, mount.rotation, field)


def views_of(placement: Placement) -> list[View]:
    """Return the views of all LiDARs of a rig."""
    return list(map(view_of, placement.mounts, map(field_of, placement.lidars)))


@njit(cache=True, nogil=True, error_model="numpy")
def in_view(view, x, y, z):
    """Return whether a point is within a field of view; the sensor's own place is not."""
    px, py, pz = x - view.origin[0], y - view.origin[1], z - view.origin[2]
    ahead, left, up = turned(view.rotation.T, px, py, pz)
    away = math.sqrt(ahead * ahead + left * left + up * up)
    if away == 0.0 or away > view.field.reach * (1.0 + _HAIR):
        return False
    return has_direction(view.field, ahead / away, left / away, up / away)


@inner
def has_direction(field, ahead, left, up):
    """Return whether a unit vector in the sensor's frame is within its field of view."""
    if not field.sines[0] - _HAIR <= up <= field.sines[1] + _HAIR:
        return False
    start, width = field.azimuth
    if width < 2.0 * math.pi - _HAIR:
        azimuth = math.atan2(left, ahead)
        if (azimuth - start + _HAIR) % (2.0 * math.pi) > width + 2.0 * _HAIR:
            return False
    if ahead < field.cosine - _HAIR:
        return False
    to_left, to_right, upwards, downwards = field.slopes
    if to_left == math.inf:
        return True
    across = -to_right * ahead - _HAIR <= left <= to_left * ahead + _HAIR
    return across and -downwards * ahead - _HAIR <= up <= upwards * ahead + _HAIR

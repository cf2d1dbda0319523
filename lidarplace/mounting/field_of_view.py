"""What a sensor can look at: a box of angles or a cone in its own frame, up to its reach.

Cameras have a pyramid, as their images are flat.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

_HAIR = 1e-12  # ends of a field of view belong to it


class FieldOfView(NamedTuple):
    """Directions in the frame of a sensor; all of these limits hold.

    Attributes:
        azimuth: the first one and how far it goes on to the left, radians.
        elevation: lowest and highest, radians.
        cosine: of half the angle of a cone about the x axis; -1: none.
        slopes: largest |y / x| and |z / x| of a pyramid about the x axis; infinite: none.
        reach: metres.
    """

    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    cosine: float
    slopes: tuple[float, float]
    reach: float


class View(NamedTuple):
    """A field of view on a vehicle: where its sensor is, and the rotation from its frame."""

    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    field: FieldOfView


@lru_cache(maxsize=64)
def field_of(lidar: Lidar) -> FieldOfView:
    """From the lowest to the highest beam; of a pattern also the cone about all of its rays."""
    start, end = lidar.azimuth
    width = 2 * math.pi if lidar.full_turn else end - start
    cosine = -1.0 if lidar.pattern is None else float(lidar.directions()[:, 0].min())
    elevation = min(lidar.elevations), max(lidar.elevations)
    return FieldOfView((start, width), elevation, cosine, (math.inf, math.inf), lidar.reach)


def pyramid(horizontal: float, vertical: float, reach: float) -> FieldOfView:
    """Of a camera with these angles between the edges of its image, radians, below pi."""
    across, up = math.tan(0.5 * horizontal), math.tan(0.5 * vertical)
    ends = (-0.5 * vertical, 0.5 * vertical)
    return FieldOfView((-0.5 * horizontal, horizontal), ends, -1.0, (across, up), reach)


def view_of(mount: Mount, field: FieldOfView) -> View:
    """What a sensor looks at on this mount."""
    return View(mount.position, mount.rotation, field)


def views_of(placement: Placement) -> list[View]:
    """Of all LiDARs of a rig."""
    pairs = zip(placement.mounts, placement.lidars, strict=True)
    return [view_of(mount, field_of(lidar)) for mount, lidar in pairs]


@njit(cache=True, nogil=True, error_model="numpy")
def in_view(view, x, y, z):
    """Whether a point is within a field of view; the sensor's own place is not."""
    px, py, pz = x - view.origin[0], y - view.origin[1], z - view.origin[2]
    r = view.rotation
    ahead = r[0, 0] * px + r[1, 0] * py + r[2, 0] * pz
    left = r[0, 1] * px + r[1, 1] * py + r[2, 1] * pz
    up = r[0, 2] * px + r[1, 2] * py + r[2, 2] * pz
    away = math.sqrt(ahead * ahead + left * left + up * up)
    if away == 0.0 or away > view.field.reach * (1.0 + _HAIR):
        return False
    return has_direction(view.field, ahead / away, left / away, up / away)


@njit(cache=True, nogil=True, error_model="numpy")
def has_direction(field, ahead, left, up):
    """Whether a unit vector in the sensor's frame is within its field of view."""
    elevation = math.asin(min(max(up, -1.0), 1.0))
    low, high = field.elevation
    if not low - _HAIR <= elevation <= high + _HAIR:
        return False
    start, width = field.azimuth
    if (math.atan2(left, ahead) - start + _HAIR) % (2.0 * math.pi) > width + 2.0 * _HAIR:
        return False
    if ahead < field.cosine - _HAIR:
        return False
    across, high_slope = field.slopes
    if across == math.inf:
        return True
    return abs(left) <= across * ahead + _HAIR and abs(up) <= high_slope * ahead + _HAIR


def seen_points(view: View, points: Sequence[Sequence[float]]) -> list[bool]:
    """Whether each point is within a field of view, whatever stands in the way."""
    return [bool(in_view(view, float(x), float(y), float(z))) for x, y, z in points]

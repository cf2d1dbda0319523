"""The body of the vehicle that carries the LiDARs, as its clouds have it.

A vehicle that nobody describes is a sedan of convex parts, a shape of its own beside
`Vehicle.car()`, whose two boxes are somewhat larger.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarplace.lidar.shapes import BODY, Parts, bricks, own_body
from lidarplace.mounting.vehicle import Vehicle, depth_in_body
from lidarplace.placement import Placement
from lidarplace.shown import point

_SEDAN = own_body()


def body_parts(vehicle: Vehicle | None) -> Parts:
    """What of the body is convex parts, without light; a sedan for None."""
    if vehicle is None:
        return _SEDAN
    low, high = vehicle.boxes[:, 0], vehicle.boxes[:, 1]
    level = np.zeros((len(low), 1))
    return bricks(np.concatenate([(low + high) / 2, high - low, level], axis=1), BODY, 0.0)


def check_mounts(rig: Placement, vehicle: Vehicle | None) -> None:
    """Raise ValueError if a LiDAR of the rig is inside of the body of its vehicle."""
    places = np.array([mount.position for mount in rig.mounts])
    held = _in_parts(_SEDAN, places) if vehicle is None else depth_in_body(vehicle, places) > 0
    if held.any():
        number = int(held.argmax())
        raise ValueError(
            f"{rig.name!r}: LiDAR {number + 1} at {point(*places[number])} is inside the vehicle's "
            "body, which the key vehicle describes"
        )


def _in_parts(parts: Parts, places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each place, shape (P, 3), is inside of a part; the surface is not."""
    x, y, z, length, width, height, yaw, front, rear, side = parts.geometry.T
    dx, dy = places[:, :1] - x, places[:, 1:2] - y
    along, aside = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
    up = (places[:, 2:] - z) / height + 0.5  # share of the height
    within = (up > 0) & (up < 1) & (np.abs(aside) < 0.5 * width - up * side)
    within &= (up * rear - 0.5 * length < along) & (along < 0.5 * length - up * front)
    return np.asarray(within.any(axis=1), np.bool_)
